"""One connection to a controller, checked: packages in, set-points out, and the program between them."""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.errors import ConfigError, DeviceLost
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.ur import checks
from services.hardware.drivers.ur.config import UrConfig
from services.hardware.drivers.ur.dashboard import ask
from services.hardware.drivers.ur.program import (
    COUNT_OUT,
    ENDING_OUT,
    ENDINGS,
    FOLLOW,
    HALT,
    INPUT_NAMES,
    OUTPUT_NAMES,
    SESSION_OUT,
    servo_program,
)
from services.hardware.drivers.ur.rtde import NotKnown, RtdeClient
from services.hardware.drivers.ur.states import PROGRAM_PLAYING, program_state, why_it_cannot_move

SCRIPT_PORT = 30002
CONNECT_S = 1.0
PROGRAM_S = 3.0  # for the program to run
_MODE_S = 0.05  # a mode may be told so long after the program that it ended
_ALWAYS = (
    "timestamp", "actual_q", "actual_qd", "target_q", "actual_TCP_pose", "robot_mode", "safety_mode", "runtime_state",
    "target_speed_fraction", *OUTPUT_NAMES,
)  # fmt: skip
_NEWER = ("tcp_offset", "payload", "payload_cog")  # 3.12 and 5.6 on
Package = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Expected:
    """What the cell's file says of the arm."""

    model: ArmModel
    payload_kg: float | None
    wrench: bool  # the wrist sensor's readings are wanted


class UrLink:
    """Connected and compared once made; raises DeviceLost or, where the cell's file does not fit, ConfigError."""

    def __init__(self, config: UrConfig, expected: Expected) -> None:
        self._config = config
        self._sending = threading.Lock()
        self._session = self._count = self._followed = 0
        self._followed_s = 0.0
        self._halted = False
        self.client = RtdeClient(config.host, CONNECT_S)
        try:
            self.version = self.client.version
            self.period_s = 0.002 if self.version[0] >= 5 else 0.008
            self.robot_model = self._check_dashboard(expected)
            self._subscribe(expected)
            self._recipe = self.client.inputs(INPUT_NAMES)
            self.client.start()
            self.first = self.client.receive(CONNECT_S)[-1]
            self._check_state(self.first, expected)
        except BaseException:
            self.client.close()
            raise

    # ------------------------------------------------------------------------------------------------ on connecting

    def _check_dashboard(self, expected: Expected) -> str:
        remote, model = ask(self._config.host, ("is in remote control", "get robot model"), CONNECT_S)
        if wrong := checks.wrong_model(expected.model.name, model, self.version):
            raise ConfigError(wrong)
        if wrong := checks.not_remote(remote, self.version):
            raise DeviceLost(f"{self._config.host}: {wrong}")
        return model

    def _subscribe(self, expected: Expected) -> None:
        wrench = (self._config.wrench,) if expected.wrench else ()
        names = (*_ALWAYS, *_NEWER, *wrench)
        try:
            self.client.subscribe(names, 1.0 / self.period_s)
        except NotKnown as error:
            if self._config.wrench in error.names:
                raise ConfigError(
                    f"hardware.ur.wrench: {self._config.host} has PolyScope {self.version[0]}.{self.version[1]}, and "
                    f"{self._config.wrench} is there from 5.9 on, on robots with a sensor in the wrist; update it, say "
                    "actual_TCP_force, or name another driver in hardware.drivers.force_torque"
                ) from None
            if "tcp_offset" in error.names:
                raise DeviceLost(
                    f"{self._config.host} has PolyScope {self.version[0]}.{self.version[1]}, which does not tell its "
                    "tool centre point; update it to 3.12 or 5.6 on"
                ) from None
            raise DeviceLost(f"{self._config.host} does not know {error}; update its PolyScope") from None

    def _check_state(self, package: Package, expected: Expected) -> None:
        flange = checks.flange_by(package["actual_TCP_pose"], package["tcp_offset"])
        wrong = checks.wrong_flange(expected.model, package["actual_q"], flange, self._config.flange_tolerance_m)
        if wrong:
            raise ConfigError(wrong)
        for why in (
            why_it_cannot_move(package["robot_mode"], package["safety_mode"]),
            checks.wrong_payload(package["payload"], expected.payload_kg, self._config.payload_tolerance_kg),
            checks.too_slow(package["target_speed_fraction"]),
        ):
            if why:
                raise DeviceLost(f"{self._config.host}: {why}")
        self.note = checks.flange_note(expected.model, package["actual_q"], flange) + (
            f", payload {package['payload']:.2f} kg"
        )

    # ------------------------------------------------------------------------------------------------------- program

    @property
    def follows(self) -> bool:
        """Whether the program was started."""
        return self._session != 0

    def start_program(self) -> None:
        """Have the arm follow set-points, standing where it stands. Raises DeviceLost where no program runs."""
        config = self._config
        hold = np.asarray(self.receive()[-1]["target_q"], float)
        session = 1 + secrets.randbelow(2**31 - 2)
        text = servo_program(
            session, self.period_s, config.lookahead_s, config.gain, config.silence_s, config.start_tolerance_rad
        )
        try:
            with socket.create_connection((config.host, SCRIPT_PORT), timeout=CONNECT_S) as scripts:
                scripts.sendall(text.encode())
                until_s = time.monotonic() + PROGRAM_S
                while time.monotonic() < until_s:
                    package = self.receive()[-1]
                    self._refuse_modes(package)
                    self._send(hold, FOLLOW, session)
                    if package[SESSION_OUT] == session and package["runtime_state"] == PROGRAM_PLAYING:
                        self._session = session
                        self._followed, self._followed_s = package[COUNT_OUT], package["timestamp"]
                        return
        except OSError as error:
            raise DeviceLost(
                f"{config.host}:{SCRIPT_PORT} takes no program ({error}); allow the secondary client interface under "
                "Settings, Security, Services on the pendant"
            ) from None
        raise DeviceLost(
            f"{config.host} did not run the servo program within {PROGRAM_S:g} s (program "
            f"{program_state(package['runtime_state'])}); its log on the pendant says why"
        )

    def _send(self, joints_rad: Array, what: int, session: int) -> None:
        with self._sending:
            self._count = (self._count + 1) % 2**30
            self.client.send(self._recipe, [self._count, session, what, *joints_rad.tolist()])

    def follow(self, joints_rad: Array) -> None:
        """The next set-point (6,), rad."""
        if not self._halted:
            self._send(joints_rad, FOLLOW, self._session)

    def halt(self) -> None:
        """Have the program stop the arm and end. Any thread may call."""
        if self._session and not self._halted:
            self._halted = True
            self._send(np.zeros(6), HALT, self._session)

    # ------------------------------------------------------------------------------------------------------- packages

    def receive(self) -> list[Package]:
        """What has come, at least one. Raises DeviceLost: silence, a mode in which the arm cannot move, no program."""
        packages = self.client.receive(self._config.silence_s)
        last = packages[-1]
        self._refuse_modes(last)
        if self._session and not self._halted:
            self._refuse_not_followed(last)
        return packages

    def _refuse_not_followed(self, package: Package) -> None:
        """The program says so as it ends; killed or replaced it says nothing more, and its registers stay."""
        if package[SESSION_OUT] != self._session or package["runtime_state"] != PROGRAM_PLAYING:
            self._refuse_ended(package)
        if package[COUNT_OUT] != self._followed or package[COUNT_OUT] == self._count:
            self._followed, self._followed_s = package[COUNT_OUT], package["timestamp"]
        elif package["timestamp"] - self._followed_s > self._config.silence_s:
            self._refuse_ended(package)

    def _refuse_modes(self, package: Package) -> None:
        why = why_it_cannot_move(package["robot_mode"], package["safety_mode"])
        if why:
            raise DeviceLost(f"{self._config.host}: {why}")

    def _refuse_ended(self, package: Package) -> None:
        """The program ended; a stop that ended it may be told a little later."""
        until_s = time.monotonic() + _MODE_S
        while time.monotonic() < until_s:
            self._refuse_modes(self.client.receive(self._config.silence_s)[-1])
        why = ENDINGS.get(package[ENDING_OUT])
        if why is None:
            state = program_state(package["runtime_state"])
            why = f"it was ended or paused on the pendant, or another was sent (program {state})"
        raise DeviceLost(f"{self._config.host}: the servo program ended: {why}")

    def close(self) -> None:
        """Let the arm stand, and end the connection."""
        with contextlib.suppress(DeviceLost):
            self.halt()
        self.client.close()
