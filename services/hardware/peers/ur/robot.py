"""The controller: its cycle, its modes, its registers, and the one program that it runs."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.peers.ur.motion import SetPoints
from services.hardware.peers.ur.sources import GRAVITY_BASE_M_S2, JointSource, SensedState
from services.hardware.peers.ur.urscript import Program, ScriptError, Steps
from services.hardware.peers.ur.variables import REGISTERS

ROBOT_MODES = {
    -1: "NO_CONTROLLER", 0: "DISCONNECTED", 1: "CONFIRM_SAFETY", 2: "BOOTING", 3: "POWER_OFF", 4: "POWER_ON",
    5: "IDLE", 6: "BACKDRIVE", 7: "RUNNING",
}  # fmt: skip
SAFETY_MODES = {
    1: "NORMAL", 2: "REDUCED", 3: "PROTECTIVE_STOP", 4: "RECOVERY", 5: "SAFEGUARD_STOP", 6: "SYSTEM_EMERGENCY_STOP",
    7: "ROBOT_EMERGENCY_STOP", 8: "VIOLATION", 9: "FAULT",
}  # fmt: skip
STOPPED, PLAYING = 1, 2  # runtime_state
_MOTORS_ON = (5, 6, 7)
_SAFETY_BITS = {1: 0, 2: 1, 3: 2, 4: 3, 5: 4, 6: 5, 7: 6, 8: 8, 9: 9}


class Outputs(dict[str, Any]):
    """The output variables of a cycle; those that cost something are reckoned when somebody has asked for them."""

    def __init__(self, values: dict[str, Any], asked: Callable[[str], Any]) -> None:
        super().__init__(values)
        self._asked = asked

    def __missing__(self, name: str) -> Any:
        self[name] = value = self._asked(name)
        return value


class Robot:
    """One controller with its arm. `lock` is held for a cycle, and by whoever changes something from outside."""

    def __init__(self, source: JointSource, model: str, version: tuple[int, int, int, int], period_s: float) -> None:
        self.source, self.model_name, self.version, self.period_s = source, model, version, period_s
        self.lock = threading.RLock()
        self.robot_mode, self.safety_mode = 7, 1
        self.remote_control = True
        self.payload_kg, self.payload_cog_m = 0.0, [0.0, 0.0, 0.0]
        self.tcp_offset = [0.0] * 6
        self.speed_slider = 1.0
        self.in_ints, self.in_doubles = [0] * REGISTERS, [0.0] * REGISTERS
        self.out_ints, self.out_doubles = [0] * REGISTERS, [0.0] * REGISTERS
        self.cycles = self.late_cycles = 0
        self.log: list[str] = []
        self._program: Program | None = None
        self._watchdog: tuple[str, float, str] | None = None
        self._heard_s: dict[str, float] = {}
        felt = source.restart(None)
        self.set_points = SetPoints(felt.joints_rad, period_s)
        self._felt = felt
        self._bias = np.zeros(6)
        self._listeners: list[Callable[[Outputs], object]] = []

    # --------------------------------------------------------------------------------------------------- from outside

    @property
    def program_running(self) -> bool:
        """Whether a program runs."""
        return self._program is not None and self._program.running

    @property
    def program_name(self) -> str:
        """Of the program that runs."""
        return self._program.name if self._program is not None else "<unnamed>"

    def on_cycle(self, listener: Callable[[Outputs], object]) -> None:
        """Called at the end of every cycle with all output variables."""
        self._listeners.append(listener)

    def write_input(self, name: str, value: Any) -> None:
        """An input variable that a client sent."""
        self._heard_s[name] = self.cycles * self.period_s
        kind, _, index = name.rpartition("_")
        if kind == "input_int_register":
            self.in_ints[int(index)] = value
        elif kind == "input_double_register":
            self.in_doubles[int(index)] = value
        elif name == "speed_slider_fraction":
            self.speed_slider = float(value)

    def load(self, text: str) -> None:
        """Run a program in the place of what runs; one that cannot be read or may not run stands in the log."""
        with self.lock:
            if self.robot_mode != 7 or self.safety_mode not in (1, 2):
                self.say("a program was sent, but the robot may not move: not run")
                return
            if self.version[0] >= 5 and not self.remote_control:
                self.say("a program was sent, but the robot is in local control: not run")
                return
            self.stop_program()
            try:
                self._program = Program(text, self._functions(), self._blocking())
            except ScriptError as error:
                self.say(f"program not run: {error}")
                return
            self.say(f"program {self._program.name} runs")

    def stop_program(self) -> None:
        """End the program that runs; what moves slows down."""
        with self.lock:
            self._program, self._watchdog = None, None
            self.set_points.halt()

    def protective_stop(self) -> None:
        """As after a collision: the program ends, the arm stops and holds."""
        with self.lock:
            self.safety_mode = 3
            self.stop_program()
            self.set_points.halt(30.0)

    def unlock_protective_stop(self) -> None:
        """As on the pendant."""
        with self.lock:
            if self.safety_mode == 3:
                self.safety_mode = 1

    def emergency_stop(self, pressed: bool) -> None:
        """The button: the motors lose their power; released, they want power and brakes again."""
        with self.lock:
            self.stop_program()
            self.set_points.halt(30.0)
            self.safety_mode, self.robot_mode = (7, 3) if pressed else (1, 3)

    def safeguard_stop(self, open_gate: bool) -> None:
        """A gate: the program ends, until it is closed."""
        with self.lock:
            if open_gate:
                self.stop_program()
            self.safety_mode = 5 if open_gate else 1

    def power(self, mode: int) -> None:
        """Another robot mode: 3 power off, 5 idle, 7 running."""
        with self.lock:
            if mode != 7:
                self.stop_program()
            self.robot_mode = mode

    def restart(self, seed: int) -> None:
        """A new trial behind the controller: no program runs, the arm is where the trial begins."""
        with self.lock:
            self.stop_program()
            self._felt = self.source.restart(seed)
            self.set_points.restart(self._felt.joints_rad)

    def nudge(self, joint: int, by_rad: float) -> None:
        """As if somebody had moved a joint by hand while no program ran."""
        with self.lock:
            joints = self.set_points.joints_rad.copy()
            joints[joint] += by_rad
            self.set_points.restart(joints)

    def say(self, line: str) -> None:
        """Into the log."""
        self.log.append(line)
        print(f"ur peer: {line}", file=sys.stderr, flush=True)

    # --------------------------------------------------------------------------------------------------------- cycle

    def run(self, closing: threading.Event) -> None:
        """Cycle after cycle at the wall's pace until told to close; counts those that began more than one late."""
        due_s = time.monotonic()
        while not closing.is_set():
            due_s += self.period_s
            ahead_s = due_s - time.monotonic()
            if ahead_s > 0.0:
                time.sleep(ahead_s)
            elif ahead_s < -self.period_s:
                self.late_cycles += 1
                if ahead_s < -0.1:
                    due_s = time.monotonic()
            self.cycle()

    def cycle(self) -> None:
        """One cycle: the program's turn, the set-points, the joints, the outputs."""
        with self.lock:
            self.cycles += 1
            self._step_program()
            self.set_points.advance()
            self._felt = self.source.advance(self.set_points.joints_rad, self.set_points.speeds_rad_s)
            outputs = self._outputs(self._felt)
        for listener in self._listeners:
            listener(outputs)

    def _step_program(self) -> None:
        program = self._program
        if program is None:
            return
        if self._watchdog is not None:
            name, longest_s, action = self._watchdog
            silent_s = self.cycles * self.period_s - self._heard_s.get(name, 0.0)
            if silent_s > longest_s:
                self.say(f"no {name} for {silent_s:.3f} s: watchdog, {action}")
                self.stop_program()
                return
        try:
            program.step()
        except ScriptError as error:
            self.say(f"program stopped: {error}")
            self.stop_program()
        if self._program is program and not program.running:
            self.stop_program()

    def _outputs(self, felt: SensedState) -> Outputs:
        running = self.program_running
        bits = 1 << _SAFETY_BITS.get(self.safety_mode, 9)
        if self.safety_mode in (6, 7):
            bits |= 1 << 7
        if self.safety_mode not in (1, 2):
            bits |= 1 << 10
        values: dict[str, Any] = {
            "timestamp": self.cycles * self.period_s,
            "target_q": self.set_points.joints_rad.tolist(),
            "target_qd": self.set_points.speeds_rad_s.tolist(),
            "actual_q": felt.joints_rad.tolist(),
            "actual_qd": felt.speeds_rad_s.tolist(),
            "ft_raw_wrench": felt.raw.tolist(),
            "tcp_offset": list(self.tcp_offset),
            "payload": self.payload_kg,
            "payload_cog": list(self.payload_cog_m),
            "robot_mode": self.robot_mode,
            "joint_mode": [253 if self.robot_mode == 7 else 239] * 6,
            "safety_mode": self.safety_mode,
            "safety_status": self.safety_mode,
            "runtime_state": PLAYING if running else STOPPED,
            "robot_status_bits": (1 if self.robot_mode in _MOTORS_ON else 0) | (2 if running else 0),
            "safety_status_bits": bits,
            "speed_scaling": self.speed_slider,
            "target_speed_fraction": self.speed_slider,
        }
        target_rad, offset_values = self.set_points.joints_rad, list(self.tcp_offset)
        flange = self.source.model.pose_base_flange
        ints, doubles = list(self.out_ints), list(self.out_doubles)

        def tcp(joints_rad: Array) -> list[float]:
            return _twist(flange(joints_rad) @ Pose.from_rotvec(offset_values[3:], offset_values[:3]))

        def asked(name: str) -> Any:
            if name.startswith("output_int_register_"):
                return ints[int(name.rpartition("_")[2])]
            if name.startswith("output_double_register_"):
                return doubles[int(name.rpartition("_")[2])]
            if name == "actual_TCP_pose":
                return tcp(felt.joints_rad)
            if name == "target_TCP_pose":
                return tcp(target_rad)
            if name == "actual_TCP_force":
                return self._compensated(felt.raw, flange(felt.joints_rad).rotation).tolist()
            return 0  # what this controller has no measurement of: temperatures, voltages, currents

        return Outputs(values, asked)

    def _compensated(self, raw: Array, rotation: Array) -> Array:
        """As an e-Series says it: in base axes, about the flange, without the payload's weight and the zero."""
        weight = rotation.T @ (self.payload_kg * GRAVITY_BASE_M_S2)
        load = np.concatenate([weight, np.cross(self.payload_cog_m, weight)])
        left = raw - load - self._bias
        return np.concatenate([rotation @ left[:3], rotation @ left[3:]])

    # ------------------------------------------------------------------------------------------- what programs may call

    def _functions(self) -> dict[str, Callable[..., Any]]:
        def write(registers: list[Any], kind: type) -> Callable[[int, Any], None]:
            def set_register(index: int, value: Any) -> None:
                registers[int(index)] = kind(value)

            return set_register

        def set_payload(mass: float, cog: list[float] | None = None, *_: Any) -> None:
            self.payload_kg, self.payload_cog_m = float(mass), list(cog or self.payload_cog_m)

        def set_tcp(pose: list[float], *_: Any) -> None:
            self.tcp_offset = [float(value) for value in pose]

        def zero_ftsensor() -> None:
            flange = self.source.model.pose_base_flange(self._felt.joints_rad)
            self._bias = np.zeros(6)
            left = self._compensated(self._felt.raw, flange.rotation)
            self._bias = np.concatenate([flange.rotation.T @ left[:3], flange.rotation.T @ left[3:]])

        def watch(name: str, least_hz: float, action: str = "pause") -> None:
            self._watchdog = (str(name), 1.0 / float(least_hz), str(action))
            self._heard_s[str(name)] = self.cycles * self.period_s

        def nothing(*_: Any, **__: Any) -> None:
            """What has no effect here."""

        return {
            "textmsg": lambda *words: self.log.append(" ".join(map(str, words))),
            "popup": lambda *words, **_: self.say(f"popup: {words[0]}"),
            "to_str": str,
            "read_input_integer_register": lambda index: self.in_ints[int(index)],
            "read_input_float_register": lambda index: self.in_doubles[int(index)],
            "write_output_integer_register": write(self.out_ints, int),
            "write_output_float_register": write(self.out_doubles, float),
            "get_actual_joint_positions": lambda: self._felt.joints_rad.tolist(),
            "get_target_joint_positions": lambda: self.set_points.joints_rad.tolist(),
            "get_steptime": lambda: self.period_s,
            "get_target_payload_cog": lambda: list(self.payload_cog_m),
            "get_target_payload": lambda: self.payload_kg,
            "get_tcp_offset": lambda: list(self.tcp_offset),
            "rtde_set_watchdog": watch,
            "set_payload": set_payload,
            "set_target_payload": set_payload,
            "set_tcp": set_tcp,
            "zero_ftsensor": zero_ftsensor,
            "protective_stop": self.protective_stop,
            "force_mode_set_gain_scaling": nothing,
            "force_mode_set_damping": nothing,
            "end_force_mode": nothing,
            "set_gravity": nothing,
            "is_steady": lambda: self.set_points.at_rest,
        }

    def _blocking(self) -> dict[str, Callable[..., Steps]]:
        def sync() -> Steps:
            yield

        def sleep(seconds: float) -> Steps:
            for _ in range(max(1, round(seconds / self.period_s))):
                yield

        def servoj(
            q: list[float], a: float = 0.0, v: float = 0.0, t: float = 0.002, lookahead_time: float = 0.1,
            gain: float = 300.0,
        ) -> Steps:  # fmt: skip
            self.set_points.servo(np.asarray(q, float), float(lookahead_time), float(gain))
            yield from sleep(float(t) or self.period_s)

        def stopj(a: float, *_: Any) -> Steps:
            self.set_points.halt(float(a))
            yield
            while not self.set_points.at_rest:
                yield

        return {"sync": sync, "sleep": sleep, "servoj": servoj, "stopj": stopj, "stopl": stopj}


def _twist(pose: Pose) -> list[float]:
    return [*pose.translation_m.tolist(), *Rotation.from_matrix(pose.rotation).as_rotvec().tolist()]
