"""The commands `crosspih topic …`."""

from __future__ import annotations

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.topic"
COMMANDS = {
    "list": OnDemand(
        f"{_HERE}.listing:list_topics",
        "All topics: key, type, who sends it, and whether that service is alive now.",
        by_cell=True,
    ),
    "echo": OnDemand(
        f"{_HERE}.echoing:echo",
        "Print the messages of a topic as they come, as YAML; of a state the last one comes at once. Ctrl-C ends it.",
        by_cell=True,
        example="ft/raw --count 1",
    ),
    "hz": OnDemand(
        f"{_HERE}.measuring:hz",
        "How often messages come: rate, shortest and longest pause, its standard deviation, and how many are missing.",
        by_cell=True,
        example="arm/joint_state --count 500",
    ),
    "delay": OnDemand(
        f"{_HERE}.measuring:delay",
        "How late messages come here: from the stamp on the cell's clock, which has to run in real time.",
        by_cell=True,
        example="force_torque/wrench --count 100",
    ),
    "bw": OnDemand(
        f"{_HERE}.measuring:bw",
        "How much travels: bytes of payload a second, and a message's least, mean and largest size.",
        by_cell=True,
        example="camera/left/image --count 5",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def topic() -> None:
    """What travels on the bus now: listed, printed, measured."""
