"""Names and types of RTDE variables, as Universal Robots' "Real-Time Data Exchange (RTDE) guide" lists them.

Only what this controller knows: what is not here is answered NOT_FOUND, as an older controller answers it.
"""

from __future__ import annotations

# RTDE type: struct codes of its elements
FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
}

REGISTERS = 48

_VECTORS = (
    "target_q", "target_qd", "target_qdd", "target_current", "target_moment", "actual_q", "actual_qd",
    "actual_current", "actual_current_window", "joint_control_output", "actual_TCP_pose", "actual_TCP_speed",
    "actual_TCP_force", "target_TCP_pose", "target_TCP_speed", "joint_temperatures", "actual_joint_voltage",
    "ft_raw_wrench", "payload_inertia", "tcp_offset",
)  # fmt: skip
_DOUBLES = (
    "timestamp", "actual_execution_time", "speed_scaling", "target_speed_fraction", "actual_momentum",
    "actual_main_voltage", "actual_robot_voltage", "actual_robot_current", "standard_analog_input0",
    "standard_analog_input1", "standard_analog_output0", "standard_analog_output1", "payload", "tcp_force_scalar",
)  # fmt: skip

OUTPUTS: dict[str, str] = (
    dict.fromkeys(_VECTORS, "VECTOR6D")
    | dict.fromkeys(_DOUBLES, "DOUBLE")
    | {
        "actual_tool_accelerometer": "VECTOR3D",
        "payload_cog": "VECTOR3D",
        "robot_mode": "INT32",
        "joint_mode": "VECTOR6INT32",
        "safety_mode": "INT32",
        "safety_status": "INT32",
        "runtime_state": "UINT32",
        "robot_status_bits": "UINT32",
        "safety_status_bits": "UINT32",
        "actual_digital_input_bits": "UINT64",
        "actual_digital_output_bits": "UINT64",
        "output_bit_registers0_to_31": "UINT32",
        "output_bit_registers32_to_63": "UINT32",
    }
    | {f"output_int_register_{index}": "INT32" for index in range(REGISTERS)}
    | {f"output_double_register_{index}": "DOUBLE" for index in range(REGISTERS)}
)

INPUTS: dict[str, str] = (
    {
        "speed_slider_mask": "UINT32",
        "speed_slider_fraction": "DOUBLE",
        "standard_digital_output_mask": "UINT8",
        "standard_digital_output": "UINT8",
        "external_force_torque": "VECTOR6D",
    }
    | {f"input_int_register_{index}": "INT32" for index in range(REGISTERS)}
    | {f"input_double_register_{index}": "DOUBLE" for index in range(REGISTERS)}
)

# first release of PolyScope (CB3's, e-Series') that has an output; the guide names them
SINCE: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "ft_raw_wrench": ((99, 0), (5, 9)),
    "payload": ((3, 11), (5, 6)),
    "payload_cog": ((3, 11), (5, 6)),
    "payload_inertia": ((3, 15), (5, 11)),
    "tcp_offset": ((3, 12), (5, 6)),
}


def known(name: str, version: tuple[int, ...]) -> bool:
    """Whether a controller of this version has the output."""
    if name not in OUTPUTS:
        return False
    old, new = SINCE.get(name, ((0, 0), (0, 0)))
    return version[:2] >= (new if version[0] >= 5 else old)
