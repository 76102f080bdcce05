"""Whether the cell's file describes the cell that was recorded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crosspih_common.config import CellFile, Workcell, cell_of_text
from crosspih_common.errors import ConfigError
from crosspih_common.recording import Recording
from services.hardware.config import HardwareConfig
from services.hardware.drivers.recorded.film import FIELD, JointTrack, RecordedPair
from services.hardware.protocols import Landing

SLACK_RAD = 0.02  # encoders say a little more than the limit at the limit


def described(workcell: Workcell, devices: frozenset[str]) -> dict[str, Any]:
    """What of a cell's file says what the devices are and hold, by the names that the fields have there.

    A correction of the sensor's mounting is left out: it says how readings are understood, not what was read.
    """
    found: dict[str, Any] = {}
    if "arm" in devices or "force_torque" in devices:
        found["arm"] = workcell.arm_section.model_dump()
        found["flange_to_ft"] = {"pose": workcell.pose_flange_peg().matrix().tolist()}
        found["gravity_base_m_s2"] = workcell.gravity_base_m_s2
        found["force_torque"] = workcell.force_torque.as_drawn().model_dump()
        found["peg"] = workcell.peg.model_dump()
    if "camera" in devices:
        found["camera"] = workcell.camera.model_dump()
    return found


def differences(recorded: Any, given: Any, where: str) -> Iterator[tuple[str, Any, Any]]:
    """(field, in the recording, in the cell's file) of each leaf that differs."""
    if isinstance(recorded, dict) and isinstance(given, dict):
        for name in recorded:
            yield from differences(recorded[name], given.get(name), f"{where}.{name}")
    elif recorded != given:
        yield where, recorded, given


def cell_then(recording: Recording) -> CellFile | None:
    """The cell's file that the recording holds. Raises ConfigError where it cannot be read here."""
    stored = recording.metadata.get("cell", {})
    if "yaml" not in stored:
        return None
    try:
        return cell_of_text(Path(stored.get("path", "recorded-cell.yaml")), stored["yaml"])
    except ConfigError as error:
        raise ConfigError(
            f"{FIELD}: the cell's file that {recording.path} holds does not read here: {error}; files that it names "
            "must be where they were when it was recorded"
        ) from None


def landing_then(cell: CellFile | None) -> Landing | None:
    """What a landing was reckoned with when this cell was recorded: with anything else its motions would be others.

    None where the file does not say: its arm's own driver declared it.
    """
    if cell is None:
        return None
    config = cell.section("hardware", HardwareConfig)
    simulated = config.simulated
    declared = Landing(simulated.landing_mass_kg, simulated.landing_stiffness_n_m)
    landing, missing = config.limits.landing(declared if config.driver_of("arm") == "simulated" else None)
    return None if missing else landing


def require_same_cell(recording: Recording, workcell: Workcell, devices: frozenset[str]) -> bool:
    """Whether the recording says what cell it is of; then it is the one of the cell's file.

    Raises ConfigError naming the first field that differs, or what of the stored description cannot be read here.
    """
    cell = cell_then(recording)
    if cell is None:
        return False
    found = list(differences(described(cell.workcell, devices), described(workcell, devices), "cell"))
    if found:
        field, recorded, given = found[0]
        more = f" (and {len(found) - 1} more: {', '.join(name for name, _, _ in found[1:4])})" if found[1:] else ""
        raise ConfigError(
            f"{field}: {recording.path} was recorded with {recorded}, the cell's file says {given}{more}; play it with "
            f"the cell's file that it was recorded with"
        )
    return True


def require_same_arm(track: JointTrack, workcell: Workcell, path: Path) -> None:
    """The arm of the cell's file could have been where the recorded one was. Raises ConfigError naming cell.arm."""
    arm, count = workcell.arm(), track.positions_rad.shape[1]
    if arm.joints != count:
        raise ConfigError(
            f"cell.arm: {arm.name} has {arm.joints} joints, {path} has {count}; play it with the cell's file that it "
            "was recorded with"
        )
    for name, positions in (("low", track.positions_rad.min(axis=0)), ("high", track.positions_rad.max(axis=0))):
        lines = arm.limits.violations(positions, SLACK_RAD)
        if lines:
            raise ConfigError(f"cell.arm: a joint of {path} was too {name} for {arm.name}: {'; '.join(lines)}")


def require_same_camera(pair: RecordedPair, workcell: Workcell, path: Path) -> None:
    """For a recording without a description: its pictures are of the size that the cell's file says."""
    # the cell's file describes two equal cameras
    cameras = pair.calibration.left, pair.calibration.right
    for name, camera in ((name, camera) for name in ("width_px", "height_px") for camera in cameras):
        recorded, given = getattr(camera, name), getattr(workcell.camera, name)
        if recorded != given:
            raise ConfigError(
                f"cell.camera.{name}: {path} was recorded with {recorded}, the cell's file says {given}; play it with "
                "the cell's file that it was recorded with"
            )
