"""`crosspih bench`: measured distributions over seeds that anyone can repeat. One module a command."""

import typer

from services.operator.bench.cells.stopping import stopped_in_order
from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.bench"
COMMANDS = {
    "assembly": OnDemand(
        f"{_HERE}.assembly.command:assembly",
        "Assemble with each of N seeds, in cells side by side, and print the distribution of what came out.",
        by_cell=True,
        example="--trials 20 --seed 1000",
        panel="Assembling",
    ),
    "domain": OnDemand(
        f"{_HERE}.domain.command:domain",
        "Assemble in cells that differ from the default in one factor each: a heat map of success.",
        by_cell=True,
        example="--trials 5 --factor friction",
        panel="Assembling",
    ),
    "scaling": OnDemand(
        f"{_HERE}.speed.commands.scaling:scaling",
        "Measure how many trials a second one cell makes, two cells, and so on, each cell on a core of its own.",
        by_cell=True,
        example="--trials 8",
        panel="Speed",
    ),
    "states": OnDemand(
        f"{_HERE}.contact_states.command:states",
        "Push the peg so that each state comes about, judge the wrenches by rule and likelihood, and say who is right.",
        by_cell=True,
        panel="Parts",
    ),
    "compare": OnDemand(
        f"{_HERE}.compare.command:compare",
        "Every strategy on the same seeds: success, time, touches, forces, errors, failures, and a score.",
        by_cell=True,
        example="--trials 2",
        panel="Assembling",
    ),
    "vision": OnDemand(
        f"{_HERE}.vision.command:vision",
        "Locate the hole over seeds, and with each fault in front of the cameras; print errors, refusals, wrong poses.",
        by_cell=True,
        example="--poses 20 --faults 0",
        panel="Parts",
    ),
    "sizes": OnDemand(
        f"{_HERE}.speed.commands.sizes:sizes",
        "Time vision on pictures from 320 x 240 to 2448 x 2048, each in a simulated cell of its own.",
        by_cell=True,
        panel="Speed",
    ),
    "pictures": OnDemand(
        f"{_HERE}.pictures.command:make_pictures",
        "Render pictures of a workshop with their truth by a path tracer, for `crosspih bench vision --pictures`.",
        example="--out run/pictures --seed 57000",
        panel="Parts",
    ),
    "refine": OnDemand(
        f"{_HERE}.refinement_gain.command:refine",
        "Assemble in a cell with unmodelled errors, refine over its recordings, and assemble the next seeds with both.",
        by_cell=True,
        example="--trials 4 --felt 2",
        panel="Assembling",
    ),
    "engines": OnDemand(
        f"{_HERE}.speed.commands.engines:engines",
        "Measure how fast each installed physics engine is.",
        panel="Speed",
    ),
    "protocols": OnDemand(
        f"{_HERE}.protocols.commands.protocols:protocols",
        "Assemble in real time in a cell whose every device is reached by its published protocol over "
        "loopback, and score by what only the other end knows. Status 1 where one was not inserted.",
        example="--trials 1",
        panel="Devices",
    ),
    "day": OnDemand(
        f"{_HERE}.protocols.commands.day:day",
        "Walk docs/hardware/in-a-day.md by its own words, before a UR5e, an ATI sensor and two cameras that "
        "are other ends of their protocols: each command, what each calibration found of what the cell hides,"
        " and whether the peg went in. Status 1 where a command failed or a peg was not inserted.",
        example="run/day",
        panel="Devices",
    ),
    "bus": OnDemand(
        f"{_HERE}.speed.bus.command:bus",
        "Measure the typed bus, from publishing to the callback in another process, beside raw Zenoh on the same route"
        " and other buses that are installed.",
        panel="Speed",
    ),
    "recorder": OnDemand(
        f"{_HERE}.speed.commands.recorder:recorder",
        "Measure how fast samples get from the bus into a file beside the bare MCAP writer, and whether four cells at"
        " once lose any.",
        panel="Speed",
    ),
    "trials": OnDemand(
        f"{_HERE}.speed.commands.trials:trials",
        "Measure where the wall time of a trial goes: physics, rendering, thinking, waiting. `bench scaling` measures"
        " what more cells make of it. Linux.",
        by_cell=True,
        panel="Speed",
    ),
    "startup": OnDemand(
        f"{_HERE}.speed.commands.startup:startup",
        "Measure how long a stack takes until all its services are ready beside the slowest single import, and the CPU"
        " time of small commands.",
        example="--rounds 1",
        panel="Speed",
    ),
    "inference": OnDemand(
        f"{_HERE}.speed.commands.inference:inference",
        "Measure what each answer of the inference service costs beside the contact mechanics in it, asked alone.",
        panel="Speed",
    ),
    "cell": OnDemand(
        f"{_HERE}.speed.commands.cell:cell",
        "Measure how fast the simulated cell is, and each physics engine by itself in the same run.",
        panel="Speed",
    ),
    "caps": OnDemand(
        f"{_HERE}.reliability.caps.command:caps",
        "Send each kind of motion at a rigid plate, up to the fastest that a message may ask for, and print "
        "how hard it truly pressed. Ends with status 0 only if none pressed more than 10 % beyond the cap.",
        by_cell=True,
        panel="Reliability",
    ),
    "kills": OnDemand(
        f"{_HERE}.reliability.kills.command:kills",
        "End each service in each phase of an assembly, and print what becomes of arm, peg and assembly. Ends"
        " with status 0 only if the arm always stops in time, the loss is named within a second, and all ends"
        " in order.",
        by_cell=True,
        panel="Reliability",
    ),
    "matrix": OnDemand(
        f"{_HERE}.reliability.matrix.command:matrix",
        "End every service, the router and the operator, in each phase of `crosspih assemble`, by each of "
        "three signals: outcome, time to the result, time until healthy, what the recording lost. Status 0 "
        "only if all cases hold.",
        by_cell=True,
        panel="Reliability",
    ),
    "soak": OnDemand(
        f"{_HERE}.reliability.soak.command:soak",
        "Assemble for an hour in one stack, and see whether memory, descriptors, threads, latency and disk "
        "stay where they are, and nothing is dropped. Status 1 where something grows, was lost, or was not "
        "inserted. Linux.",
        by_cell=True,
        example="--minutes 5",
        panel="Reliability",
    ),
    "fuzz": OnDemand(
        f"{_HERE}.reliability.fuzz.command:fuzz",
        "Draw payloads from every message's own schema, sound, absurd and broken; decode them, and send them "
        "to a cell.",
        by_cell=True,
        panel="Reliability",
    ),
    "busy": OnDemand(
        f"{_HERE}.reliability.busy.command:busy",
        "Assemble while other processes keep the machine busy. Ends with status 0 only if no assembly was "
        "stopped by the arm's lease or because a living service was taken for lost.",
        by_cell=True,
        panel="Reliability",
    ),
    "hosts": OnDemand(
        f"{_HERE}.reliability.hosts.command:hosts",
        "Assemble with the stack on one host and split over three, which are network namespaces made for it: "
        "also over a link that is slow and loses packets, one that is cut, and with clocks apart. Needs root,"
        " on Linux.",
        by_cell=True,
        panel="Reliability",
    ),
    "calibrations": OnDemand(
        f"{_HERE}.calibrations.command:calibrations",
        "What stereo, hand-eye, tcp, mount and stiffness find, against what simulated cells hide from the services.",
        by_cell=True,
        example="--cells 2",
        panel="Parts",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def bench(context: typer.Context) -> None:
    """Measured distributions over seeds that anyone can repeat."""
    context.with_resource(stopped_in_order())
