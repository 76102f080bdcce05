"""Programs on the controller of the peer: the language, servoj as its manual says, the servo program of the driver."""

from __future__ import annotations

import numpy as np
import pytest

from services.hardware.drivers.ur import program as servo
from services.hardware.peers.ur.motion import SetPoints
from services.hardware.peers.ur.robot import Robot
from services.hardware.peers.ur.urscript import Program, ScriptError, Steps, whole_programs
from tests.hardware.drivers.ur.ur_peer import CB3, E_SERIES, robot

SESSION = 4711


def ran(text: str, turns: int = 20) -> list[object]:
    said: list[object] = []

    def sync() -> Steps:
        yield

    program = Program(text, {"say": said.append}, {"sync": sync})
    for _ in range(turns):
        program.step()
    return said


def test_names_of_functions_are_their_own_and_globals_are_shared() -> None:
    assert ran(
        """def main():
  global shared = 1
  own = 5   # of the program: one variable for all of it
  def change(own_value):
    shared = shared + own_value
    inner = 7
    return inner
  end
  say(change(2))
  say(shared)
  say(own)
end
"""
    ) == [7, 3, 5]


def test_threads_take_turns_and_end_with_the_program() -> None:
    text = """def main():
  global count = 0
  thread counter():
    while True:
      count = count + 1
      sync()
    end
  end
  handle = run counter()
  sync()
  sync()
  kill handle
  sync()
  sync()
  say(count)
end
"""
    assert ran(text) == [2]


def test_poses_conditions_and_lines_that_go_on() -> None:
    text = """def main():
  global offset = # put in by who sends it
3    global other = 4
  where = p[0, 0, 1, 0, 0, 0]
  where[2] = where[2] * 2
  if offset == 1:
    say("one")
  elif offset == 3 and other == 4:
    say(where)
  else:
    say("none")
  end
end
"""
    assert ran(text) == [[0, 0, 2, 0, 0, 0]]


def test_programs_are_taken_from_a_stream_whole() -> None:
    stream = "def a():\n  if True:\n    sync()\n  end\nend\nset_payload(1.0)\ndef b():\n  sync()\n"
    found, rest = whole_programs(stream)
    assert [text.split("\n")[0] for text in found] == ["def a():", "set_payload(1.0)"]
    found, rest = whole_programs(rest + "end\n")
    assert found == ["def b():\n  sync()\nend\n"] and not rest


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def a():\n  if True:\nend\n", "not ended"),
        ("def a():\n  1 +\nend\n", "not a program"),
        ("def a():\n  freedrive_mode()\nend\n", "no function"),
        ("def a():\n  x = [1]\n  y = x[3]\nend\n", "IndexError"),
    ],
)
def test_what_cannot_run_says_why(text: str, words: str) -> None:
    with pytest.raises(ScriptError, match=words):
        ran(text)


@pytest.mark.parametrize("lookahead_s", [0.03, 0.1])
def test_servoj_follows_a_ramp_its_lookahead_late(lookahead_s: float) -> None:
    points = SetPoints(np.zeros(6), 0.002)
    for cycle in range(1500):
        points.servo(np.full(6, 0.2 * cycle * 0.002), lookahead_s, 2000.0)
        points.advance()
    late_s = (0.2 * 1499 * 0.002 - points.joints_rad[0]) / 0.2
    assert late_s == pytest.approx(lookahead_s, abs=0.003)
    assert points.speeds_rad_s == pytest.approx(np.full(6, 0.2), rel=1e-3)


def test_servoj_comes_to_its_target_and_stopj_to_rest() -> None:
    points = SetPoints(np.zeros(6), 0.002)
    most = 0.0
    for _ in range(500):
        points.servo(np.full(6, 0.01), 0.03, 2000.0)
        points.advance()
        most = max(most, points.joints_rad[0])
    assert points.joints_rad == pytest.approx(np.full(6, 0.01), abs=1e-6)
    assert most < 0.0106  # damping gain**.5 * lookahead / 2 = 0.67: five per cent over
    points.servo(np.full(6, 1.0), 0.03, 2000.0)
    for _ in range(20):
        points.advance()
    points.halt(15.0)
    cycles = int(np.ceil(points.speeds_rad_s[0] / 15.0 / 0.002))
    for _ in range(cycles + 1):
        points.advance()
    assert points.at_rest


class Told:
    """The servo program of the driver on a controller, with set-points written into its registers."""

    def __init__(self, version: tuple[int, int, int, int] = E_SERIES) -> None:
        self.robot: Robot = robot(version)
        self.home = self.robot.set_points.joints_rad.copy()
        self.count = 0
        period_s = self.robot.period_s
        self.robot.load(servo.servo_program(SESSION, period_s, 0.03, 2000.0, 0.1, 0.01))

    def tell(self, joints_rad: np.ndarray, what: int = servo.FOLLOW, session: int = SESSION) -> None:
        self.count += 1
        values = [self.count, session, what, *joints_rad]
        for name, value in zip(servo.INPUT_NAMES, values, strict=True):
            self.robot.write_input(name, value)

    def cycle(self, times: int = 1) -> None:
        for _ in range(times):
            self.robot.cycle()

    @property
    def ending(self) -> int:
        return self.robot.out_ints[26]

    def runs(self) -> bool:
        return self.robot.program_running

    def stands(self) -> bool:
        return self.robot.set_points.at_rest


@pytest.mark.parametrize("version", [E_SERIES, CB3])
def test_the_servo_program_follows_and_says_so(version: tuple[int, int, int, int]) -> None:
    told = Told(version)
    goal = told.home + 0.02
    for step in range(1, 401):
        told.tell(told.home + 0.02 * min(1.0, step / 200))
        told.cycle()
    assert told.robot.out_ints[24:26] == [SESSION, told.count]
    assert told.robot.set_points.joints_rad == pytest.approx(goal, abs=1e-4)


def test_without_set_points_it_stops_and_ends() -> None:
    told = Told()
    for step in range(100):
        told.tell(told.home + 0.0005 * step)
        told.cycle()
    told.cycle(49)
    assert told.runs()
    told.cycle(60)
    assert not told.runs() and told.ending == servo.SILENT
    stood = told.robot.set_points.joints_rad.copy()
    told.cycle(500)
    assert np.array_equal(told.robot.set_points.joints_rad, stood)


def test_a_first_set_point_that_is_elsewhere_is_not_followed() -> None:
    told = Told()
    told.cycle(3)
    told.tell(told.home + 0.1)
    told.cycle(40)
    assert not told.runs() and told.ending == servo.TOO_FAR
    assert told.robot.set_points.joints_rad == pytest.approx(told.home, abs=1e-9)


def test_told_to_stop_it_stops() -> None:
    told = Told()
    for step in range(100):
        told.tell(told.home + 0.001 * step)
        told.cycle()
    assert not told.stands()
    told.tell(told.home, servo.HALT)
    told.cycle(60)
    assert told.stands() and told.ending == servo.TOLD


def test_set_points_of_another_session_are_nobodys() -> None:
    told = Told()
    told.tell(told.home)
    told.cycle(2)
    for _ in range(20):
        told.tell(told.home + 0.3, session=SESSION + 1)
        told.cycle()
    assert told.robot.set_points.joints_rad == pytest.approx(told.home, abs=1e-9)


def test_a_protective_stop_ends_the_program_and_the_motion() -> None:
    told = Told()
    for step in range(100):
        told.tell(told.home + 0.001 * step)
        told.cycle()
    told.robot.protective_stop()
    told.cycle(20)
    assert told.stands() and not told.runs()
    told.robot.load("def again():\n  sync()\nend\n")
    assert not told.runs() and "may not move" in told.robot.log[-1]
