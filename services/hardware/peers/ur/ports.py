"""The controller's ports: RTDE (30004), dashboard (29999), and those that take programs (30001, 30002, 30003)."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable

from services.hardware.peers.ur.robot import ROBOT_MODES, SAFETY_MODES, Outputs, Robot
from services.hardware.peers.ur.rtde_server import RtdeSession
from services.hardware.peers.ur.urscript import whole_programs

RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORTS = 30004, 29999, (30001, 30002, 30003)


class ControllerPorts:
    """Listens on the controller's ports of one address; `cut` and `silence` are what cables and power do."""

    def __init__(self, robot: Robot, address: str) -> None:
        self._robot, self._address = robot, address
        self._claims: dict[str, RtdeSession] = {}
        self._sessions: list[RtdeSession] = []
        self._connections: list[socket.socket] = []
        self._lock = threading.Lock()
        self._listening: list[socket.socket] = []
        self._silent_until_s = 0.0
        robot.on_cycle(self._send)
        self._open()

    def _open(self) -> None:
        handlers: dict[int, Callable[[socket.socket], None]] = {RTDE_PORT: self._rtde, DASHBOARD_PORT: self._dashboard}
        handlers |= dict.fromkeys(SCRIPT_PORTS, self._script)
        for port, handle in handlers.items():
            listener = socket.create_server((self._address, port), reuse_port=False)
            self._listening.append(listener)
            threading.Thread(target=self._accept, args=(listener, handle), daemon=True).start()

    def close(self) -> None:
        """Every connection ends, nobody is let in."""
        with self._lock:
            listening, self._listening = self._listening, []
            sessions, self._sessions = self._sessions, []
            connections, self._connections = self._connections, []
            self._claims.clear()
        for listener in listening:
            with contextlib.suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        for session in sessions:
            session.close()
        for connection in connections:
            with contextlib.suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                connection.shutdown(socket.SHUT_RDWR)

    def cut(self, seconds: float) -> None:
        """The controller's network goes down, every connection with it, and comes back so much later."""
        self.close()
        threading.Timer(seconds, self._open).start()

    def silence(self, seconds: float) -> None:
        """The cable is out: nothing is sent and no connection ends; when it is back, the old ones are dead."""
        self._silent_until_s = time.monotonic() + seconds
        threading.Timer(seconds, self._after_silence).start()

    def _after_silence(self) -> None:
        self.close()
        self._open()

    def _accept(self, listener: socket.socket, handle: Callable[[socket.socket], None]) -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            if time.monotonic() < self._silent_until_s:
                with self._lock:
                    self._connections.append(connection)
                continue  # let in by the kernel, answered by nobody
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._handle, args=(connection, handle), daemon=True).start()

    def _handle(self, connection: socket.socket, handle: Callable[[socket.socket], None]) -> None:
        with self._lock:
            self._connections.append(connection)
        with contextlib.suppress(OSError):
            handle(connection)
        with self._lock, contextlib.suppress(ValueError):
            self._connections.remove(connection)
        connection.close()

    # ---------------------------------------------------------------------------------------------------------- RTDE

    def _rtde(self, connection: socket.socket) -> None:
        session = RtdeSession(connection, self._robot, self._claims)
        with self._lock:
            self._sessions.append(session)
        session.run()
        with self._lock, contextlib.suppress(ValueError):
            self._sessions.remove(session)

    def _send(self, outputs: Outputs) -> None:
        if time.monotonic() < self._silent_until_s:
            return
        with self._lock:
            sessions = list(self._sessions)
        for session in sessions:
            session.offer(outputs, self._robot.cycles)

    # -------------------------------------------------------------------------------------------------------- scripts

    def _script(self, connection: socket.socket) -> None:
        text = ""
        while data := connection.recv(65536):
            programs, text = whole_programs(text + data.decode())
            for program in programs:
                self._robot.load(program)

    # ------------------------------------------------------------------------------------------------------ dashboard

    def _dashboard(self, connection: socket.socket) -> None:
        connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
        text = ""
        while data := connection.recv(4096):
            text += data.decode()
            while "\n" in text:
                line, text = text.split("\n", 1)
                connection.sendall((self._dashboard_answer(line.strip()) + "\n").encode())

    def _dashboard_answer(self, line: str) -> str:
        robot = self._robot
        running = robot.program_running
        said = {
            "robotmode": f"Robotmode: {ROBOT_MODES[robot.robot_mode]}",
            "safetymode": f"Safetymode: {SAFETY_MODES[robot.safety_mode]}",
            "safetystatus": f"Safetystatus: {SAFETY_MODES[robot.safety_mode]}",
            "programstate": f"{'PLAYING' if running else 'STOPPED'} {robot.program_name}",
            "running": f"Program running: {'true' if running else 'false'}",
            "get robot model": robot.model_name,
            "get serial number": "20990000000",
            "is in remote control": "true" if robot.remote_control else "false",
            "polyscopeversion": "URSoftware " + ".".join(map(str, robot.version)) + " (Jan 01 2023)",
            "get loaded program": "No program loaded",
        }.get(line.lower())
        if said is not None:
            return said
        if line.lower() in ("stop", "unlock protective stop", "power on", "power off", "brake release"):
            if robot.version[0] >= 5 and not robot.remote_control:
                return f"Failed to execute: {line}"
            acts: dict[str, tuple[Callable[[], None], str]] = {
                "stop": (robot.stop_program, "Stopped"),
                "unlock protective stop": (robot.unlock_protective_stop, "Protective stop releasing"),
                "power on": (lambda: robot.power(5), "Powering on"),
                "power off": (lambda: robot.power(3), "Powering off"),
                "brake release": (lambda: robot.power(7), "Brake releasing"),
            }
            act, answer = acts[line.lower()]
            act()
            return answer
        return f'could not understand: "{line}"'
