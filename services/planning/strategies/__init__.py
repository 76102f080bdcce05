"""The strategies by name: what to do between seeing the hole and sitting in it."""

from __future__ import annotations

from collections.abc import Callable

from crosspih_common.messages import PosePrior, Strategy
from services.planning.run import Run
from services.planning.strategies.admittance import admittance
from services.planning.strategies.force_alone import force_alone
from services.planning.strategies.fused import fused
from services.planning.strategies.known_pose import known_pose
from services.planning.strategies.network_spiral import network_spiral
from services.planning.strategies.paper import paper
from services.planning.strategies.sequence import sequence
from services.planning.strategies.spiral import spiral
from services.planning.strategies.straight import straight
from services.planning.strategies.tilt import tilt
from services.planning.strategies.vision_only import vision_only

STRATEGIES: dict[Strategy, Callable[[Run], PosePrior]] = {
    Strategy.FUSED: fused,
    Strategy.FORCE_ALONE: force_alone,
    Strategy.PAPER: paper,
    Strategy.STRAIGHT: straight,
    Strategy.VISION_ONLY: vision_only,
    Strategy.SPIRAL: spiral,
    Strategy.TILT: tilt,
    Strategy.ADMITTANCE: admittance,
    Strategy.NETWORK_SPIRAL: network_spiral,
    Strategy.SEQUENCE: sequence,
    Strategy.KNOWN_POSE: known_pose,
}
