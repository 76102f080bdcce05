"""Only a simulated cell has these. Truth is for scoring, training labels and tests: no service reads it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from crosspih_common.messages.base import MAX_SEQ, Frame, Message, Part, PoseData, Vector3, Vector6

# m and rad; the hole stays within the arm's reach, or is told to be outside it
Offset6 = Annotated[tuple[Annotated[float, Field(ge=-3.2, le=3.2)], ...], Field(min_length=6, max_length=6)]


class SceneFaults(Part):
    """What is wrong in front of the simulated cameras. The default is a sound scene."""

    light_scale: float = Field(default=1.0, ge=0.0, le=4.0, description="factor on all light")
    glare: float = Field(default=0.0, ge=0.0, le=500.0, description="grey levels of a round reflection near the rim")
    covered_arm: int | None = Field(default=None, ge=0, le=3, description="an obstacle hides the +x, +y, -x or -y side")
    hole: bool = Field(default=True, description="False: a plate without a hole")
    square: bool = Field(default=False, description="a dark square pocket on the plate")
    second_cross: bool = Field(default=False, description="a second, identical fixture beside the first")
    swapped: bool = Field(default=False, description="left and right pictures exchanged")
    right_rows_px: float = Field(default=0.0, ge=-20.0, le=20.0, description="rows the right camera is off by")


class ResetCell(Message):
    """Start a new trial: hole, light and noise drawn from the seed, the arm at home.

    `offset_hole` overrides the draw (m and rad about the nominal hole: x, y, z, rx, ry, rz); `place_peg` puts the peg
    in front of the hole at that pose in the hole frame, so that training contacts need no drive. `scene` puts faults in
    front of the cameras.
    """

    seed: int = Field(ge=0, le=MAX_SEQ)
    offset_hole: Offset6 | None = None
    place_peg: PoseData | None = None
    scene: SceneFaults | None = None


class TrueContact(Part):
    """One contact point of the simulator."""

    point_base_m: Vector3
    force_base_n: Vector3


class SimulationTruth(Message):
    """What the simulator knows: the hole's and the peg's real poses, and the real contacts."""

    frame: Frame = Frame.BASE
    seed: int
    pose_base_hole: PoseData
    pose_base_peg: PoseData
    wrench_contact: Vector6 = Field(description="on the peg, in the peg frame, from the contact points alone")
    contacts: tuple[TrueContact, ...] = ()
    peak_contact_n: float | None = Field(
        default=None, description="the largest force of contact in any step since the reset; where the cell watches it"
    )
