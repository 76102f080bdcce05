"""The recorded arm, sensor and cameras as devices."""

from __future__ import annotations

import threading

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.bus.codec import decode
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, Image
from services.hardware.drivers.recorded.film import RecordedPair, WrenchTrack
from services.hardware.drivers.recorded.playback import Playback
from services.hardware.protocols import JointReading, StereoCapture, WrenchSamples


class RecordedJoints:
    """Implements JointDevice: reads what was recorded, and refuses to be told anything else."""

    def __init__(self, playback: Playback, model: ArmModel) -> None:
        self._playback, self.model = playback, model
        self.period_s = playback.period_ns * 1e-9

    def read(self) -> JointReading:
        """The next cycle, when it is due."""
        return self._playback.next_state()

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Where the recorded arm went: else CommandRefused not_recorded."""
        self._playback.tell(positions_rad)

    def halt(self) -> None:
        """Play no further."""
        self._playback.halt("it was halted")


class RecordedWrench:
    """Implements WrenchDevice: the recorded samples, each once its time has come, and no others."""

    def __init__(self, playback: Playback, track: WrenchTrack) -> None:
        self._playback, self._track = playback, track
        self.period_s = track.period_ns * 1e-9
        # what came before the first cycle was heard before it
        self._next = int(np.searchsorted(track.stamps_ns, playback.now_ns, side="right"))

    def read(self) -> WrenchSamples:
        """The samples since the last read; none where none are recorded, and none while the arm stands."""
        first, track = self._next, self._track
        if not self._playback.plays:
            return WrenchSamples(track.stamps_ns[:0], track.wrenches[:0])
        while self._next < len(track.stamps_ns) and track.stamps_ns[self._next] <= self._playback.now_ns:
            self._next += 1
        return WrenchSamples(track.stamps_ns[first : self._next], track.wrenches[first : self._next])


class RecordedCamera:
    """Implements CameraDevice: the recorded pairs, one after the other.

    With an arm that is played beside it a pair is given when its exposure has ended, and one that nobody asked for in
    time is passed over. Without one (a process of its own) there is no time: each capture gives the next pair.
    """

    def __init__(
        self, pairs: tuple[RecordedPair, ...], playback: Playback | None, realtime: bool, wait_s: float, speed: float
    ) -> None:
        self._pairs, self._playback = pairs, playback
        self._wait_s, self._speed = wait_s if realtime else 0.0, speed
        self._next = 0
        self._lock = threading.Lock()
        first = pairs[0]
        self.exposure_s = first.exposure_s / (first.exposure_scale or 1.0)

    def calibration(self) -> CameraCalibration:
        """As the cameras said it with the pair that comes next."""
        return self._pairs[min(self._next, len(self._pairs) - 1)].calibration

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """The next pair. Raises CommandRefused not_recorded: no more, too late, or taken in another light."""
        with self._lock:
            pair = self._coming()
            for name, asked, recorded in (
                ("exposure_scale", exposure_scale, pair.exposure_scale),
                ("lamp", lamp, pair.lamp),
            ):
                if recorded is not None and recorded != asked:
                    raise CommandRefused(
                        "not_recorded",
                        f"{name}: {asked:g} is asked for, and the next pair (at {self._at(pair)}) was taken with "
                        f"{recorded:g}; a recording has no other",
                    )
            self._next += 1
        left, right = (decode(Image, sample.payload, sample.label, sample.key) for sample in (pair.left, pair.right))
        return StereoCapture(pair.stamp_ns, pair.exposure_s, left.pixels, right.pixels, left.encoding, right.encoding)

    def _coming(self) -> RecordedPair:
        playback = self._playback
        if playback is not None:
            earliest_ns = playback.now_ns - playback.period_ns
            while self._next < len(self._pairs) and self._pairs[self._next].end_ns < earliest_ns:
                self._next += 1
        if self._next >= len(self._pairs):
            raise CommandRefused(
                "not_recorded",
                f"no picture is left: the last of {len(self._pairs)} pairs was taken at {self._at(self._pairs[-1])}",
            )
        pair = self._pairs[self._next]
        if playback is None:
            return pair
        ahead_s = (pair.end_ns - playback.now_ns) * 1e-9
        if ahead_s > self._wait_s + playback.period_ns * 1e-9:
            raise CommandRefused(
                "not_recorded",
                f"the next pair was taken at {self._at(pair)}, {ahead_s:.3f} s from now; {self._wait_s:g} s are waited "
                "for (hardware.recorded.picture_wait_s, in real time)",
            )
        if self._wait_s and not playback.wait_until(pair.end_ns, 1.0 + ahead_s / self._speed):
            raise CommandRefused("not_recorded", f"the pair of {self._at(pair)} did not come: {playback.stands}")
        return pair

    def _at(self, pair: RecordedPair) -> str:
        if self._playback is None:
            return f"{pair.stamp_ns * 1e-9:.3f} s of the cell's clock"
        return f"{self._playback.since_s(pair.stamp_ns):.3f} s"


def pairs_from(pairs: tuple[RecordedPair, ...], from_ns: int) -> tuple[RecordedPair, ...]:
    """The pairs that were exposed from then on."""
    return tuple(pair for pair in pairs if pair.stamp_ns >= from_ns)


__all__ = ["RecordedCamera", "RecordedJoints", "RecordedWrench", "pairs_from"]
