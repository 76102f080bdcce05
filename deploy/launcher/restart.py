"""When a service that ended is started again: Compose's ``restart``, with Docker's back-off.

The delay starts at 0.1 s and doubles with every restart that did not last; one that ran for 10 s counts as a new
beginning (Docker's engine does the same, up to 1 min; here up to 10 s, as an operator is waiting).
"""

import re
from dataclasses import dataclass
from enum import Enum

from crosspih_common.errors import CONFIG_STATUS

FIRST_DELAY_S = 0.1
LONGEST_DELAY_S = 10.0
STEADY_AFTER_S = 10.0

_ON_FAILURE = re.compile(r"on-failure(?::(\d+))?")


class RestartWhen(str, Enum):
    """The four policies of Compose; ALWAYS and UNLESS_STOPPED differ only for an engine that outlives the machine."""

    NO = "no"
    ALWAYS = "always"
    ON_FAILURE = "on-failure"
    UNLESS_STOPPED = "unless-stopped"


@dataclass(frozen=True)
class RestartPolicy:
    """``when`` to restart and, for ON_FAILURE, how many times in a row at most (None: without limit)."""

    when: RestartWhen = RestartWhen.NO
    max_retries: int | None = None

    @classmethod
    def parse(cls, text: str) -> "RestartPolicy":
        """Read Compose's ``no | always | on-failure[:n] | unless-stopped``; raises ValueError on anything else."""
        if matched := _ON_FAILURE.fullmatch(text):
            return cls(RestartWhen.ON_FAILURE, int(matched.group(1)) if matched.group(1) else None)
        return cls(RestartWhen(text))


@dataclass(frozen=True)
class RestartDecision:
    """Start again after ``delay_s``; ``attempt`` counts the restarts in a row that did not last."""

    delay_s: float
    attempt: int


def decide(policy: RestartPolicy, exit_code: int, ran_s: float, attempt: int) -> RestartDecision | None:
    """Whether a service is started again, after it ended with ``exit_code`` (negative: by that signal).

    ``ran_s`` is how long it ran and ``attempt`` the attempt of the decision that started it (0 for the first start).
    None means that it stays down, as whoever says by CONFIG_STATUS that it cannot read its settings: they are the same
    the next time.
    """
    if exit_code == CONFIG_STATUS:
        return None
    if policy.when is RestartWhen.NO or (policy.when is RestartWhen.ON_FAILURE and exit_code == 0):
        return None
    so_far = 0 if ran_s >= STEADY_AFTER_S else attempt
    if policy.max_retries is not None and so_far >= policy.max_retries:
        return None
    # The exponent is bounded so that a service that fails for days does not overflow the float.
    return RestartDecision(min(LONGEST_DELAY_S, FIRST_DELAY_S * 2.0 ** min(so_far, 30)), so_far + 1)
