"""What a controller says of itself, named, and what mends it (RTDE guide: robot_mode, safety_mode, runtime_state)."""

from __future__ import annotations

ROBOT_RUNNING = 7
SAFE_TO_MOVE = (1, 2)  # normal, reduced
PROGRAM_PLAYING = 2

_ROBOT_MODES: dict[int, tuple[str, str]] = {
    -1: ("no controller", "wait until it has started"),
    0: ("disconnected", "wait until the controller has found its arm"),
    1: ("confirm safety", "confirm the safety configuration on the pendant"),
    2: ("booting", "wait until it has started"),
    3: ("power off", "switch the arm on and release its brakes on the pendant"),
    4: ("power on", "wait, then release the brakes on the pendant"),
    5: ("idle, brakes closed", "release the brakes on the pendant"),
    6: ("backdrive", "let go of the freedrive button"),
    7: ("running", ""),
    8: ("updating firmware", "wait until it is done"),
}
_SAFETY_MODES: dict[int, tuple[str, str]] = {
    1: ("normal", ""),
    2: ("reduced", ""),
    3: ("protective stop", "clear what it ran into, then unlock it on the pendant"),
    4: ("recovery", "move the joints back inside their limits on the pendant"),
    5: ("safeguard stop", "close the gate, or whatever stands on the safeguard input"),
    6: ("system emergency stop", "release the button of the machine around it, then switch the arm on"),
    7: ("robot emergency stop", "release the button, then switch the arm on and release its brakes"),
    8: ("violation of a safety limit", "restart the safety system on the pendant"),
    9: ("fault", "restart the controller; its log names the fault"),
    10: ("joint ids not validated", "see the pendant"),
    11: ("safety mode undefined", "see the pendant"),
    12: ("safeguard stop of automatic mode", "close the gate, or leave automatic mode"),
    13: ("three-position switch", "hold the enabling switch in its middle position"),
}
_RUNTIME: dict[int, str] = {0: "stopping", 1: "stopped", 2: "playing", 3: "pausing", 4: "paused", 5: "resuming"}


def why_it_cannot_move(robot_mode: int, safety_mode: int) -> str | None:
    """The mode that is in the way, with its mend; None where none is."""
    for mode, names, free, kind in (
        (safety_mode, _SAFETY_MODES, SAFE_TO_MOVE, "safety mode"),
        (robot_mode, _ROBOT_MODES, (ROBOT_RUNNING,), "robot mode"),
    ):
        if mode not in free:
            name, mend = names.get(mode, ("unknown to this driver", "see the pendant"))
            return f"{kind} {mode}, {name}: {mend}"
    return None


def program_state(runtime_state: int) -> str:
    """The name of a `runtime_state`."""
    return _RUNTIME.get(runtime_state, f"runtime state {runtime_state}")
