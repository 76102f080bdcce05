"""A witness of the peer: ur-rtde, which others wrote, connects, uploads its own program, and moves the arm by it."""

from __future__ import annotations

import time

import numpy as np
import pytest

from services.hardware.peers.process import PeerProcess
from tests.hardware.drivers.ur.ur_peer import address

receive = pytest.importorskip("rtde_receive")
control = pytest.importorskip("rtde_control")
dashboard = pytest.importorskip("dashboard_client")


def test_ur_rtde_reads_what_the_controller_sends_and_servos_it() -> None:
    host = address()
    peer = PeerProcess("services.hardware.peers.ur", ["--address", host])
    try:
        board = dashboard.DashboardClient(host)
        board.connect()
        assert (board.robotmode(), board.safetystatus()) == ("Robotmode: RUNNING", "Safetystatus: NORMAL")
        assert board.getRobotModel() == "UR5" and board.isInRemoteControl()
        reader = receive.RTDEReceiveInterface(host)
        joints = np.array(reader.getActualQ())
        assert joints == pytest.approx([-0.48, -1.94, -1.89, 0.85, 2.0, -2.06])
        assert np.linalg.norm(reader.getFtRawWrench()[:3]) == pytest.approx(0.974 * 9.81, abs=0.6)
        assert (reader.getRobotMode(), reader.getSafetyMode()) == (7, 1)
        writer = control.RTDEControlInterface(host)
        assert writer.isProgramRunning() and "program rtde_control runs" in peer.tell("log")
        goal = joints.copy()
        for step in range(1, 201):
            goal[0] = joints[0] + 0.02 * min(1.0, step / 150)
            began = writer.initPeriod()
            assert writer.servoJ(goal.tolist(), 0.0, 0.0, 0.002, 0.03, 2000.0)
            writer.waitPeriod(began)
        until_s = time.monotonic() + 10.0
        while abs(reader.getActualQ()[0] - goal[0]) > 1e-4:
            assert time.monotonic() < until_s, "it did not come there"
        assert writer.servoStop()
        writer.stopScript()
        assert not peer.tell("state")["program"]
        writer.disconnect()
        reader.disconnect()
        board.disconnect()
    finally:
        peer.close()
