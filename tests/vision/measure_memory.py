"""What vision's memory does over many pairs: `python -m tests.vision.measure_memory --pairs 400`; with `--shell` by way
of the service's shell and the bus, over a router on loopback, cameras, vision and asker in this one process.

Prints after every 20 pairs what the kernel counts (resident), what the C allocator has given out (in use: arenas and
mapped blocks) and keeps free, how many objects Python has, and what the bounded tables of vision hold. Memory that is
kept by somebody grows in use; memory that the allocator keeps grows resident alone. glibc on Linux.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT, LOCATE
from crosspih_common.messages import (
    CameraCalibration,
    CaptureStereo,
    Frame,
    Image,
    LocateHole,
    PoseData,
    StereoPair,
)
from crosspih_common.service import ServiceContext
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.vision.config import VisionConfig
from services.vision.detect import edge_fit
from services.vision.locate import locate_rim
from services.vision.refusals import VisionRefusal
from services.vision.shell import VisionShell
from services.vision.stereo import StereoModel
from tests.conftest import started_router
from tests.vision.pictures.drawn_pairs import Look, drawn_pair

EVERY, WARM_UP = 20, 60
KINDS = ["arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"]


class Allocated(ctypes.Structure):
    """glibc's mallinfo2, bytes."""

    _fields_ = [(name, ctypes.c_size_t) for name in KINDS]


def looked_at(seed: int) -> tuple[Pose, Look]:
    """A hole somewhere within the prior of the default cell, in the base, and how it looks."""
    rng = np.random.default_rng(seed)
    prior = Workcell().hole_prior
    off = rng.uniform(-1.0, 1.0, 6) * np.asarray(prior.half_ranges(), float)
    look = Look(
        face=rng.uniform(120.0, 230.0), chamfer=rng.uniform(60.0, 220.0), wall=rng.uniform(30.0, 90.0),
        bottom=rng.uniform(8.0, 40.0), background=rng.uniform(5.0, 60.0), relief=rng.uniform(0.0, 0.4),
        light_rad=rng.uniform(0.0, 6.0), marks=rng.choice([0.0, 0.05]), gradient=rng.uniform(0.0, 0.2),
        glints=int(rng.integers(0, 4)), covered=rng.choice([0.0, 0.0, 0.0, 0.2]), through=bool(rng.integers(0, 2)),
        blur_px=rng.uniform(0.5, 1.0), noise=rng.uniform(1.0, 4.0), seed=seed,
    )  # fmt: skip
    return prior.pose_base_hole() @ Pose.from_rotvec(off[3:], off[:3]), look


def resident_mb() -> float:
    """Of this process."""
    fields = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(fields["VmRSS"].split()[0]) / 1024.0


Grey = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
Ask = Callable[[Grey, Grey], bool]


def calibration() -> CameraCalibration:
    """The default cell's cameras."""
    rig = StereoRig.of(Workcell().camera)
    left, right = rig.models()
    beside = PoseData.of(Pose.from_translation([rig.baseline_m, 0.0, 0.0]))
    return CameraCalibration(
        left=left, right=right, pose_left_right=beside, pose_base_camera=PoseData.of(rig.pose_base_camera)
    )


@contextmanager
def by_core() -> Iterator[Ask]:
    """Whether the core finds the hole."""
    workcell = Workcell()
    hole, prior = workcell.hole.shape(workcell.peg.shape()), workcell.hole_prior
    stereo = StereoModel.of(calibration())

    def ask(left: Grey, right: Grey) -> bool:
        try:
            locate_rim(left, right, stereo, hole, prior.pose_base_hole(), np.asarray(prior.half_ranges(), float))
        except VisionRefusal:
            return False
        return True

    yield ask


@contextmanager
def by_shell() -> Iterator[Ask]:
    """Whether the service finds it: over Zenoh, each with a session of its own."""
    router, endpoint = started_router()
    cell = load_cell("deploy/cells/default.yaml")
    showing: list[Grey] = []
    try:
        hardware, vision, asker = (
            Bus(open_zenoh(endpoint), cell.workcell.name, name) for name in ("hardware", "vision", "operator")
        )
        with hardware, vision, asker:
            publishers = hardware.publisher(IMAGE_LEFT), hardware.publisher(IMAGE_RIGHT)
            said, taken = calibration(), 0

            def capture(command: CaptureStereo) -> StereoPair:
                nonlocal taken
                taken += 1
                frames = Frame.CAMERA_LEFT, Frame.CAMERA_RIGHT
                for publisher, frame, picture in zip(publishers, frames, showing, strict=True):
                    publisher.publish(Image(frame.value, picture, taken))
                return StereoPair(capture_id=taken, stamp_ns=taken, calibration=said, exposure_s=0.01)

            hardware.serve(CAPTURE, capture)
            shell = VisionShell(ServiceContext("vision", cell, vision), VisionConfig())

            def ask(left: Grey, right: Grey) -> bool:
                showing[:] = [left, right]
                try:
                    asker.call(LOCATE, LocateHole(), 120.0)
                except CommandRefused as e:
                    print(e)
                    return False
                return True

            yield ask
            shell.close()
    finally:
        router.terminate()


def main() -> None:
    """Look at many pairs, and say what memory does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=400)
    parser.add_argument("--shell", action="store_true", help="by way of the service's shell and the bus")
    parser.add_argument("--trace", action="store_true", help="which lines of Python hold more at the end")
    told = parser.parse_args()
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = Allocated
    workcell = Workcell()
    hole, stereo = workcell.hole.shape(workcell.peg.shape()), StereoModel.of(calibration())
    found = 0

    def say(what: str) -> None:
        gc.collect()
        held = libc.mallinfo2()
        print(
            f"{what:>8} {resident_mb():8.1f} {(held.uordblks + held.hblkhd) / 2**20:8.2f} {held.fordblks / 2**20:8.1f} "
            f"{len(gc.get_objects()):8d} {edge_fit._two_steps.cache_info().currsize:6d} {found:6d}",
            flush=True,
        )

    print(f"{'pairs':>8} {'resident':>8} {'in use':>8} {'free':>8} {'objects':>8} {'tables':>6} {'found':>6}  (MB)")
    before = None
    if told.trace:
        tracemalloc.start(8)
    with by_shell() if told.shell else by_core() as ask:
        for number in range(told.pairs):
            truth, look = looked_at(number)
            drawn = drawn_pair(stereo, hole, stereo.pose_base_camera.inverse() @ truth, look)
            left, right = (np.clip(np.rint(picture), 0, 255).astype(np.uint8) for picture in drawn)
            found += ask(left, right)
            if (number + 1) % EVERY == 0:
                say(str(number + 1))
            if told.trace and number + 1 == WARM_UP:
                before = tracemalloc.take_snapshot()
        if before is not None:
            for row in tracemalloc.take_snapshot().compare_to(before, "lineno")[:12]:
                print(row)
        libc.malloc_trim(0)
        say("trimmed")


if __name__ == "__main__":
    main()
