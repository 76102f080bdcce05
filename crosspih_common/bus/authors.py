"""Which process may publish as which service: a liveliness token claims a service's name for one process, and each
sample carries the session that sent it.

Every bus claims the name of its service by the liveliness token `service/<name>/author/<process>/<session>`, which the
router removes when the process ends. A name belongs to its first claimant while that process lives: samples that
another session sends under this name are discarded and reported. Samples that arrive before any claim are held back,
the newest of each subscription, until somebody claims the name.
"""

from __future__ import annotations

import random
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from enum import Enum, auto

from crosspih_common.bus.transport import Closeable, Transport
from crosspih_common.keys import CAMERA_ALIVE, CLOCK, author_key

# One id for each process: all its sessions, such as those of the arm and the camera, belong to the same service.
PROCESS = uuid.uuid4().hex
NOBODY: frozenset[str] = frozenset()
# Names that several processes may claim at once: a person may look at the cell from two windows.
SHARED_NAMES = frozenset(["operator"])
# A claim and the first sample after it travel separately, so the sample may arrive first.
CLAIM_ARRIVES_S = 2.0
HELD_TOO_LONG_S = 1.0
# For some milliseconds after a session was opened, until the router knows it, only its own process may answer it
# (measured: one of 14 first questions while six sessions opened at once, none after the second).
NOBODY_FOR_S = 0.3
MAX_HELD = 8  # samples of one key; pictures are large
MAX_HOLDING = 256  # pairs of key and author: bounds the memory that invented names can take


class SampleStanding(Enum):
    """Whether a sample's sender holds the service name that it used."""

    RIGHTFUL = auto()
    UNCLAIMED = auto()  # nobody holds the name, or not yet
    ANOTHER = auto()  # the name is somebody else's


def names_of(publisher: str, path: str) -> tuple[str, ...]:
    """The service names that may publish a topic; empty for a topic with one key per service.

    The camera may run in another process than the arm.
    """
    if publisher == "{service}":
        return ()
    if publisher == CLOCK.publisher and path.startswith("camera/"):
        return publisher, CAMERA_ALIVE
    return (publisher,)


class HeldBack:
    """The newest samples of one subscription, key and author that came before the author's claim."""

    __slots__ = ("author", "deliver", "key", "names", "said", "since")

    def __init__(self, key: str, names: tuple[str, ...], author: str) -> None:
        self.key, self.names, self.author = key, names, author
        self.deliver: deque[Callable[[], None]] = deque(maxlen=MAX_HELD)
        self.since, self.said = time.monotonic(), False


class Authors:
    """The claims on the bus as one process sees them; `standing` costs two look-ups."""

    def __init__(self, transport: Transport, cell: str, on_forged: Callable[[str, str], None]) -> None:
        self._transport, self._cell, self._on_forged = transport, cell, on_forged
        self._changed = threading.Condition()
        self._claims: dict[str, dict[str, set[str]]] = {}  # name: process: sessions, in the order of arrival
        # name: the sessions that speak for it; looked into at every sample, where a call would cost more than that
        self.rightful: dict[str, frozenset[str]] = {}
        self._held: dict[tuple[int, str, str], HeldBack] = {}
        self._watch = transport.watch_alive(author_key(cell), self._on_claim)

    # ---------------------------------------------------------------------------------------------------- who is who

    def _on_claim(self, key: str, alive: bool) -> None:
        *_, name, _, process, session = key.split("/")
        with self._changed:
            processes = self._claims.setdefault(name, {})
            sessions = processes.setdefault(process, set())
            if alive:
                sessions.add(session)
            else:
                sessions.discard(session)
            if not sessions:
                del processes[process]
            holders, forged = self._holders(name), list[HeldBack]()
            for where, held in list(self._held.items()):
                if holders and name in held.names:
                    del self._held[where]
                    if held.author not in holders:
                        forged.append(held)
                        continue
                    for deliver in held.deliver:
                        deliver()
            # last: samples that arrive meanwhile wait in `speaks`, so that they cannot overtake the held ones
            self.rightful[name] = holders
            self._changed.notify_all()
        for held in forged:
            self._on_forged(held.key, self.forged(held.key, held.names, held.author))

    def _holders(self, name: str) -> frozenset[str]:
        processes = list(self._claims[name].values())
        return frozenset().union(*(processes if name in SHARED_NAMES else processes[:1]))

    def standing(self, names: tuple[str, ...], author: str) -> SampleStanding:
        """Whether a session is the holder of one of the names."""
        claimed = False
        for name in names:
            holders = self.rightful.get(name)
            if holders:
                if author in holders:
                    return SampleStanding.RIGHTFUL
                claimed = True
        return SampleStanding.ANOTHER if claimed else SampleStanding.UNCLAIMED

    def claimed_by(self, names: tuple[str, ...], author: str, deadline_s: float) -> bool:
        """Whether a session claims one of the names, first or not, waiting for the claim to arrive."""

        def claims() -> bool:
            return any(author in sessions for name in names for sessions in self._claims.get(name, {}).values())

        with self._changed:
            return bool(author) and self._changed.wait_for(claims, deadline_s)

    def forged(self, key: str, names: tuple[str, ...], author: str) -> str:
        """The text of the warning about a sample whose sender does not hold the name."""
        return f"{key}: session {author or 'without a name'} does not speak for {' or '.join(names)}; thrown away"

    # ------------------------------------------------------------------------------------------------ before a claim

    def speaks(
        self, names: tuple[str, ...], author: str, subscription: int, key: str, deliver: Callable[[], None]
    ) -> bool:
        """Whether a sample's author holds one of the names.

        While no process has claimed the names the sample is held back, and delivered once its author claims one. If
        another process holds them, the sample is reported as forged.
        """
        if (standing := self.standing(names, author)) is SampleStanding.RIGHTFUL:
            return True
        if standing is SampleStanding.UNCLAIMED:
            with self._changed:
                if (standing := self.standing(names, author)) is SampleStanding.UNCLAIMED:
                    where = subscription, key, author
                    if where not in self._held and len(self._held) < MAX_HOLDING:
                        self._held[where] = HeldBack(key, names, author)
                    if where in self._held:
                        self._held[where].deliver.append(deliver)
                    return False
        if standing is SampleStanding.ANOTHER:
            self._on_forged(key, self.forged(key, names, author))
        return standing is SampleStanding.RIGHTFUL

    def tell_of_held(self) -> None:
        """Report held samples whose author never claimed the name; called from time to time."""
        now, said = time.monotonic(), []
        with self._changed:
            for held in self._held.values():
                if not held.said and now - held.since > HELD_TOO_LONG_S:
                    held.said = True
                    said.append(held)
        for held in said:
            self._on_forged(held.key, self.forged(held.key, held.names, held.author))

    # ------------------------------------------------------------------------------------------------------ to claim

    def claim(self, name: str) -> Closeable:
        """Claim a name for this process."""
        return self._transport.claim(author_key(self._cell, name, PROCESS, self._transport.author))

    def claim_alone(self, name: str, deadline_s: float, stop: threading.Event) -> Closeable | None:
        """Claim a name exclusively: wait until no other process claims it; None if that does not happen in time.

        If two processes claim it at once, both withdraw and try again after pauses of different length. Raises BusError
        if the router does not answer which claims there are.
        """
        until = time.monotonic() + deadline_s
        while True:
            if self._nobody_else(name):
                token = self.claim(name)
                if not self.others(name):
                    return token
                token.close()
            if time.monotonic() > until or stop.wait(random.uniform(0.05, 0.3)):
                return None

    def _nobody_else(self, name: str) -> bool:
        until = time.monotonic() + NOBODY_FOR_S
        while not self.others(name):
            with self._changed:  # a new claim ends the wait; the lock is not held during a query of the router
                if not self._changed.wait_for(lambda: self._told_of(name), 0.03) and time.monotonic() > until:
                    return True
        return False

    def others(self, name: str) -> set[str]:
        """The other processes that claim a name, by a query of the router and by its notifications."""
        answered = {key.split("/")[-2] for key in self._transport.living(author_key(self._cell, name))}
        with self._changed:
            return answered - {PROCESS} | self._told_of(name)

    def _told_of(self, name: str) -> set[str]:
        return set(self._claims.get(name, ())) - {PROCESS}

    def close(self) -> None:
        """Stop watching claims."""
        self._watch.close()
