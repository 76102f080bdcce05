"""The simulated cell's time: one physics engine, one millisecond a step, behind thin devices."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import SensorMounting
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.protocol import STEP_NS, STEP_S, Physics
from services.hardware.drivers.simulated.sensor import SensorModel
from services.hardware.drivers.wall_pace import WallPace
from services.hardware.protocols import JointReading, WrenchSamples

FEED_FORWARD_S = 0.005


class World:
    """Engine, sensor and time. The motor side goes straight from one reference to the next within a cycle.

    `period_s` is the arm's cycle, a whole number of steps; `delay_s` is how late a sample of the sensor is heard.
    """

    def __init__(self, engine: Physics, config: SimulatedConfig, drawn: SensorMounting, realtime: bool) -> None:
        self.engine = engine
        self._sensor = SensorModel(config.force_torque)
        # the engine feels in the peg frame, or where the truth has shifted it; the sensor says it as it is mounted
        to_sensor, to_raw = drawn.sensor_of_peg, np.diag(config.truth.ft_factors) @ drawn.raw_of_sensor
        # the usual sensor says N and Nm in the peg frame: 1000 times a second nothing need be turned
        self._sensor_of_peg = None if np.array_equal(to_sensor, np.eye(6)) else to_sensor
        self._raw_of_sensor = None if np.array_equal(to_raw, np.eye(6)) else to_raw
        self.steps_a_cycle = max(1, round(config.period_s / STEP_S))
        self.period_s = self.steps_a_cycle * STEP_S
        self._delay_ns = round(config.delay_s * 1e9)
        self._pace: Callable[[int], None] = WallPace() if realtime else lambda now_ns: None
        self.peak_contact_n: float | None = 0.0 if config.watch_contact else None
        self.lock = threading.Lock()  # around one step: whoever looks at the engine from outside takes it
        self.now_ns = 0
        self._started_ns = 0
        self.joints_rad = np.zeros(0)
        self._speeds_rad_s = self._none = np.zeros(0)  # no speed, no acceleration
        self._next: tuple[Array, Array] = self.joints_rad, self._speeds_rad_s
        # what the arm's own controller feeds forward: the change of speed over some milliseconds, not of one cycle
        self._past_speeds: deque[Array] = deque(maxlen=1 + max(1, round(FEED_FORWARD_S / self.period_s)))
        self._samples: deque[tuple[int, Array]] = deque()
        self._started = False

    def start(self, pose_base_hole: Pose, joints_rad: Array, rng: np.random.Generator) -> None:
        """A new trial: at rest at joints (n,), new noise; time goes on. Take the lock around it."""
        self.engine.build(pose_base_hole, joints_rad)
        self.joints_rad = np.array(joints_rad, dtype=float)
        self._speeds_rad_s = self._none = np.zeros(len(joints_rad))
        self._next = self.joints_rad, self._speeds_rad_s
        self._past_speeds.clear()
        self._past_speeds.append(self._speeds_rad_s)
        self._sensor.start(rng)
        self._started_ns = self.now_ns
        self._samples.clear()
        self.peak_contact_n = None if self.peak_contact_n is None else 0.0
        self._started = True

    def write(self, joints_rad: Array, speeds_rad_s: Array) -> None:
        """Where the motor side is at the end of the next cycle."""
        self._next = joints_rad, speeds_rad_s

    def cycle(self) -> JointReading:
        """One cycle of the arm. The first one after a start is where it stands: no time goes by."""
        if self._started:
            self._started = False
            return JointReading(self.now_ns, self.joints_rad, self._speeds_rad_s)
        goal, speeds = self._next
        before, before_speeds = self.joints_rad, self._speeds_rad_s
        self._past_speeds.append(speeds)
        past = self._past_speeds[0]
        accelerations = (
            self._none if speeds is past else (speeds - past) / ((len(self._past_speeds) - 1) * self.period_s)
        )
        count = self.steps_a_cycle
        for step in range(1, count + 1):
            if step == count:
                at, rate = goal, speeds
            else:
                at = before + (goal - before) * (step / count)
                rate = before_speeds + (speeds - before_speeds) * (step / count)
            with self.lock:
                self.engine.step(at, rate, accelerations)
                ideal = self.engine.wrench_sensed()
                if self.peak_contact_n is not None:
                    force = sum((contact.force_base_n for contact in self.engine.contacts()), np.zeros(3))
                    self.peak_contact_n = max(self.peak_contact_n, float(np.linalg.norm(force)))
                self.now_ns += STEP_NS
            if self._sensor_of_peg is not None:
                ideal = self._sensor_of_peg @ ideal
            raw = self._sensor.sample(ideal, (self.now_ns - self._started_ns) * 1e-9)
            if self._raw_of_sensor is not None:
                raw = self._raw_of_sensor @ raw
            self._samples.append((self.now_ns, raw))
            self._pace(self.now_ns)
        self.joints_rad, self._speeds_rad_s = goal, speeds
        return JointReading(self.now_ns, goal, speeds)

    def arrived_samples(self) -> WrenchSamples:
        """The samples that have come since they were last asked for."""
        if len(self._samples) == 1 and not self._delay_ns:
            stamp_ns, sample = self._samples.popleft()
            return WrenchSamples(np.array((stamp_ns,)), sample[None])
        ready = []
        while self._samples and self._samples[0][0] <= self.now_ns - self._delay_ns:
            ready.append(self._samples.popleft())
        if not ready:
            return WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
        return WrenchSamples(
            np.array([stamp for stamp, _ in ready], dtype=np.int64), np.array([sample for _, sample in ready])
        )


class SimulatedJoints:
    """The joint device: the encoders are on the motor side, which follows its reference exactly."""

    def __init__(self, world: World, model: ArmModel) -> None:
        self._world, self.model = world, model
        self.period_s = world.period_s

    def read(self) -> JointReading:
        """The next cycle."""
        return self._world.cycle()

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """The reference of the next cycle."""
        self._world.write(positions_rad, speeds_rad_s)

    def halt(self) -> None:
        """The motor side stays where it is."""
        self._world.write(self._world.joints_rad, np.zeros(len(self._world.joints_rad)))


class SimulatedWrench:
    """The wrench device."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.period_s = STEP_S

    def read(self) -> WrenchSamples:
        """The samples since the last read."""
        return self._world.arrived_samples()
