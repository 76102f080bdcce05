"""A controller that speaks the lines of docs/examples/line_arm.py: `python -m docs.examples.line_peer [PORT]`.

Its joints go where they are told, its sensor feels the wall of docs/examples/spring_wall.py. Whoever hangs up stops it.
"""

from __future__ import annotations

import socket
import sys
import time

import numpy as np

from crosspih_common.config import Workcell
from docs.examples.spring_wall import Joints, WallSensor

PERIOD_S = 0.008
WALL = {"wall_z_m": 0.2}


def serve(port: int) -> None:
    """One client after the other, until killed."""
    cell = Workcell()
    joints = Joints(cell.arm(), np.asarray(cell.home_joints_rad, float), wait=False)
    sensor = WallSensor(joints, cell.pose_flange_peg(), cell.peg.shape().tip_m, WALL)
    began = time.monotonic()
    with socket.create_server(("127.0.0.1", port)) as server:
        print(f"listens on port {server.getsockname()[1]}", flush=True)
        while True:
            client, _ = server.accept()
            with client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                try:
                    client.sendall(f"LINES 1 {joints.model.joints} {round(PERIOD_S * 1e6)}\n".encode("ascii"))
                    _cycles(client, joints, sensor, began)
                except OSError:
                    joints.halt()


def _cycles(client: socket.socket, joints: Joints, sensor: WallSensor, began: float) -> None:
    due, heard = time.monotonic(), b""
    while True:
        values = (*joints.positions_rad, *joints.speeds_rad_s, *sensor.read().wrenches[0])
        stamp_us = round((time.monotonic() - began) * 1e6)
        client.sendall(f"S {stamp_us} {' '.join(f'{value:.9f}' for value in values)}\n".encode("ascii"))
        due += PERIOD_S
        while (left := due - time.monotonic()) > 0.0:
            client.settimeout(left)
            try:
                part = client.recv(65536)
            except TimeoutError:
                break
            if not part:
                raise ConnectionError("the client hung up")
            *lines, heard = (heard + part).split(b"\n")
            for line in lines:
                words = line.split()
                if words and words[0] == b"P":
                    numbers = np.array([float(word) for word in words[1:]])
                    joints.write(*np.split(numbers, 2))
                else:
                    joints.halt()


if __name__ == "__main__":
    serve(int(sys.argv[1]) if len(sys.argv) > 1 else 5757)
