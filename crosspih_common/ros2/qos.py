"""Quality of service as rmw_zenoh writes it into liveliness tokens (`qos_to_keyexpr` in liveliness_utils.cpp).

Six parts with colons between: reliability, durability, history kind and depth, deadline, lifespan, liveliness with its
lease. An empty part is rmw_zenoh's default: reliable, volatile, keep last 42, no deadline, no lifespan, automatic.
"""

from __future__ import annotations

from dataclasses import dataclass

DEFAULT_DEPTH = 42
_RELIABLE, _BEST_EFFORT = "1", "2"
_TRANSIENT_LOCAL, _VOLATILE = "1", "2"
_KEEP_ALL = "2"


@dataclass(frozen=True, slots=True)
class RosQos:
    """What a publisher offers or a subscriber asks for; `depth` 0 keeps all."""

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10

    def encode(self) -> str:
        """The token's last part."""
        reliability = "" if self.reliable else _BEST_EFFORT
        durability = _TRANSIENT_LOCAL if self.transient_local else ""
        depth = "" if self.depth in (0, DEFAULT_DEPTH) else str(self.depth)
        history = f"{'' if self.depth else _KEEP_ALL},{depth}"
        return f"{reliability}:{durability}:{history}:,:,:,,"

    @classmethod
    def decode(cls, text: str) -> RosQos:
        """Parse the last part of a token. Raises ValueError for any other text."""
        parts = text.split(":")
        if len(parts) < 6 or "," not in parts[2]:
            raise ValueError(f"{text!r} is no quality of service of rmw_zenoh")
        kind, depth = parts[2].split(",", 1)
        return cls(
            reliable=parts[0] != _BEST_EFFORT,
            transient_local=parts[1] == _TRANSIENT_LOCAL,
            depth=0 if kind == _KEEP_ALL else int(depth or DEFAULT_DEPTH),
        )


RELIABLE = RosQos()
