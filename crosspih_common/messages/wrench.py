"""Wrenches: as the sensor gives them, and as contact alone would give them."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import (
    MAX_MAGNITUDE,
    Deviations6,
    Frame,
    Message,
    Part,
    PoseData,
    RawVector6,
    Vector3,
    Vector6,
)
from crosspih_common.messages.contact import ContactState


class RawWrenchBatch(Message):
    """The samples of some 10 ms, as many as the sensor gives, one each `period_ns`; `stamp_ns` is the first one's time.

    The numbers are the sensor's own, in its units, axes and sign: `cell.force_torque` in the cell's file says how they
    are to be read, and whoever reads them does that.
    """

    frame: Frame = Frame.FT
    period_ns: int = Field(gt=0, le=10**9)
    samples: tuple[RawVector6, ...] = Field(min_length=1, max_length=10_000)


class WrenchMemory(Part):
    """What the service remembers after a batch: with it a recording can be gone through again from there."""

    filtered: Vector6 = Field(description="the low-pass's last output, peg frame")
    run_samples: int = Field(description="consecutive samples that contradict the present state of contact")
    run_stamp_ns: int = Field(description="of the first of them")
    run_wrench: Vector6
    free_mean: Vector6 = Field(description="running mean of the contact wrench in free air")
    free_samples: int
    settle_left: int = Field(description="samples to be left out of that mean after a contact")
    judged_ns: int = Field(description="stamp of the last contact state that was told; 0: none was")


class ContactWrench(Message):
    """Force on the peg by contact: bias and gravity removed, in the peg frame about its origin.

    The batch of `ft/raw` that ends at `stamp_ns` was compensated at the newest joint state that had been heard then.
    """

    frame: Frame = Frame.PEG
    wrench: Vector6
    in_contact: bool
    free_residual_n: float = Field(description="running mean of |F| in free air: the error that the calibration leaves")
    drift_suspected: bool
    joint_stamp_ns: int = Field(default=-1, description="stamp of that joint state; -1: not known (older recordings)")
    calibration_seq: int = Field(default=-1, description="the `seq` of the calibration in use")
    memory: WrenchMemory | None = Field(default=None, description="now and then")

    @property
    def force_n(self) -> tuple[float, ...]:
        """The force (3,), N, of `wrench`."""
        return self.wrench[:3]

    @property
    def moment_nm(self) -> tuple[float, ...]:
        """The moment (3,) about the peg frame's origin, Nm, of `wrench`."""
        return self.wrench[3:]


class CompensateWrench(Message):
    """Ask for the contact wrench of one averaged raw reading (`wrench_raw`, `wrench_sd` as the sensor gives them).

    `wrench_free_raw`, a reading in free air shortly before at about the same orientation, takes a slow drift out.
    """

    pose_base_peg: PoseData
    wrench_raw: RawVector6
    wrench_sd: Deviations6
    wrench_free_raw: RawVector6 | None = None
    pose_base_peg_free: PoseData | None = None


class ContactReading(Message):
    """A compensated reading and the contact state that it looks like."""

    frame: Frame = Frame.PEG
    wrench: Vector6
    wrench_sd: Deviations6
    free_residual: Vector6 | None = None
    state: ContactState


class RawReading(Message):
    """One dwell of a calibration: the sensor's mean and the orientation it was taken in."""

    frame: Frame = Frame.FT
    pose_base_peg: PoseData
    wrench_raw: RawVector6
    wrench_sd: Deviations6


class IdentifyPayload(Message):
    """Six or more dwells, to find bias, weight and centroid from (the paper's Eqs. 14-16)."""

    readings: tuple[RawReading, ...] = Field(max_length=1000)
    save: bool = True
    temperature_c: float | None = Field(
        default=None,
        ge=-MAX_MAGNITUDE,
        le=MAX_MAGNITUDE,
        description="present temperature; stored with the calibration",
    )


class FtCalibration(Message):
    """Bias, weight and centroid of what hangs behind the sensor, and how well they fit.

    `bias` is in N and Nm in the sensor's frame, after the raw numbers are read as `cell.force_torque` says;
    `centroid_m` is in the sensor's frame.
    """

    calibrated: bool = True
    date: str = ""
    frame: Frame = Frame.FT
    bias: Vector6
    weight_n: float
    centroid_m: Vector3
    gravity_base: Vector3
    weight_base_n: Vector3 | None = Field(
        default=None, description="weight_n times gravity_base, to the last bit; None in older recordings"
    )
    residual_force_n: float
    residual_moment_nm: float
    poses: int
    file: str = ""
