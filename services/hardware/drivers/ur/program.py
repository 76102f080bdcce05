"""The program that the controller runs: it follows the set-points that come by RTDE, and stops when none come.

Registers 24 to 47 are those that Universal Robots leaves to RTDE clients. In: int 24 a count that goes on with each
set-point, int 25 the session, int 26 what to do (1 follow, 2 stop); double 24 to 29 the joints, rad. Out: int 24 the
session of the program that runs, int 25 the last count it has followed, int 26 why it ended (0 it has not, 1 told to
stop, 2 no set-point came, 3 the first set-point was too far from where a joint stands).
"""

from __future__ import annotations

FOLLOW, HALT = 1, 2
RUNNING, TOLD, SILENT, TOO_FAR = range(4)
ENDINGS = {
    TOLD: "it was told to stop",
    SILENT: "no set-point came for hardware.ur.silence_s; give the loop a core of its own, or the network a switch of "
    "its own",
    TOO_FAR: "the first set-point was further from where a joint stands than hardware.ur.start_tolerance_rad",
}
INPUT_NAMES = (
    "input_int_register_24", "input_int_register_25", "input_int_register_26",
    *(f"input_double_register_{index}" for index in range(24, 30)),
)  # fmt: skip
SESSION_OUT, COUNT_OUT, ENDING_OUT = "output_int_register_24", "output_int_register_25", "output_int_register_26"
OUTPUT_NAMES = (SESSION_OUT, COUNT_OUT, ENDING_OUT)
HALT_RAD_S2 = 15.0  # of each joint
FIRST_WAIT_S = 5.0  # for the first set-point
START_SLACK_RAD = 0.02  # what encoders and set-points differ by while the arm is held, beside the start tolerance

_TEXT = """\
def crosspih_servo():
  global follow = True
  global target = get_target_joint_positions()
  global ending = 0
  thread servo_thread():
    while follow:
      enter_critical
      q = target
      exit_critical
      servoj(q, t={period_s}, lookahead_time={lookahead_s}, gain={gain})
    end
  end
  here = get_target_joint_positions()
  last = read_input_integer_register(24)
  followed = False
  silent = 0
  longest = {first_cycles}
  write_output_integer_register(25, last)
  write_output_integer_register(26, 0)
  servo_handle = run servo_thread()
  write_output_integer_register(24, {session})
  while follow:
    count = read_input_integer_register(24)
    if read_input_integer_register(25) == {session} and count != last:
      last = count
      silent = 0
      longest = {silent_cycles}
      q0 = read_input_float_register(24)
      q1 = read_input_float_register(25)
      q2 = read_input_float_register(26)
      q3 = read_input_float_register(27)
      q4 = read_input_float_register(28)
      q5 = read_input_float_register(29)
      wanted = [q0, q1, q2, q3, q4, q5]
      if not followed:
        followed = True
        joint = 0
        while joint < 6:
          if wanted[joint] - here[joint] > {tolerance_rad} or here[joint] - wanted[joint] > {tolerance_rad}:
            ending = 3
            follow = False
          end
          joint = joint + 1
        end
      end
      if read_input_integer_register(26) == 2:
        ending = 1
        follow = False
      elif follow:
        enter_critical
        target = wanted
        exit_critical
        write_output_integer_register(25, count)
      end
    else:
      silent = silent + 1
      if silent > longest:
        ending = 2
        follow = False
      end
    end
    sync()
  end
  kill servo_handle
  stopj({halt_rad_s2})
  write_output_integer_register(26, ending)
  write_output_integer_register(24, 0)
end
"""


def servo_program(
    session: int, period_s: float, lookahead_s: float, gain: float, silence_s: float, tolerance_rad: float
) -> str:
    """The program's text for a session, a number that no other program has."""
    return _TEXT.format(
        session=session, period_s=period_s, lookahead_s=lookahead_s, gain=gain,
        silent_cycles=max(2, round(silence_s / period_s)), first_cycles=round(FIRST_WAIT_S / period_s),
        tolerance_rad=tolerance_rad + START_SLACK_RAD, halt_rad_s2=HALT_RAD_S2,
    )  # fmt: skip
