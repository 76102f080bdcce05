"""The sentences of a report: the task, the method and the result. Only what happened is described."""

from __future__ import annotations

from crosspih_common.messages import Strategy
from services.operator.report.model import Facts
from services.operator.report.numbers import number

PUSHES = {
    Strategy.FUSED: "pushes while yielding; where the peg does not enter it touches the rim and works out from the "
    "forces how it is off",
    Strategy.FORCE_ALONE: "feels for the hole by touching, works out from the forces where it is, and pushes while "
    "yielding",
    Strategy.PAPER: "touches, lets a network tell the angles from one wrench, and corrects, as in the paper",
    Strategy.STRAIGHT: "pushes straight in",
    Strategy.VISION_ONLY: "pushes in under position control",
    Strategy.SPIRAL: "pushes while yielding, and searches along a spiral where that does not enter",
    Strategy.TILT: "pushes while yielding, and tilts at random where that does not enter",
    Strategy.ADMITTANCE: "pushes while yielding",
    Strategy.NETWORK_SPIRAL: "corrects by a network and searches along a spiral",
    Strategy.SEQUENCE: "touches, and lets a network tell the pose from the sequence of touches",
    Strategy.KNOWN_POSE: "pushes while yielding at the pose that is known from an assembly with another peg",
}


def counted(count: int, one: str, many: str | None = None) -> str:
    """1 touch, 2 touches."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def verdict(facts: Facts) -> tuple[str, str, str]:
    """(css class, headline, sentence)."""
    result, figures = facts.window.result, facts.figures
    if result is None or figures is None:
        return "unknown", "No result in this recording", "The assembly had not ended when the file did."
    if figures.inserted:
        return "good", "Inserted", what_happened(facts)
    where = "The peg was backed off." if result.backed_off else "The peg was not backed off."
    name = (figures.failure or "no reason given").replace("_", " ")
    said = result.failure_detail
    said = said if not said or said.endswith(".") else f"{said}."
    return "bad", f"Not inserted: {name}", " ".join(filter(None, (said, where)))


def how(facts: Facts) -> str:
    """What such an assembly is, for somebody who has not seen one: with this peg, by this strategy."""
    prior = facts.workcell.hole_prior
    peg = {"round": "round"}.get(facts.outline, f"{facts.outline}-shaped")
    known = (
        f"whose place was known to ±{number(prior.half_range_lateral_m * 1e3, 0)} mm across and "
        f"±{number(prior.half_range_depth_m * 1e3, 0)} mm along its axis, and its tilt to "
        f"±{number(prior.half_range_rotation_rad * 180.0 / 3.141592653589793, 1)}°"
    )
    first = f"A robot arm is to put a {peg} peg into its hole, {known}."
    result = facts.window.result
    if result is None:
        return first
    strategy = result.strategy
    does = PUSHES[strategy] if isinstance(strategy, Strategy) else "goes about it in a way of its own"
    return f"{first} Strategy {strategy.value}: {_looking(facts)}the arm {does}."


def _looking(facts: Facts) -> str:
    figures = facts.figures
    if figures is None or not figures.looked:
        return "the cameras are not asked; " if not _told(facts) else ""
    if figures.vision_refused:
        return f"the cameras are asked (here vision refused: {figures.vision_refused.replace('_', ' ')}); then "
    return "two cameras tell where the hole is; then "


def _told(facts: Facts) -> bool:
    return facts.window.result is not None and facts.window.result.strategy is Strategy.KNOWN_POSE


def what_happened(facts: Facts) -> str:
    """One sentence on an assembly that inserted its peg."""
    result, figures = facts.window.result, facts.figures
    assert result is not None and figures is not None
    touches, presses = len(facts.touches), len(facts.presses)
    by = f"after {counted(touches, 'touch', 'touches')} and {counted(result.corrections, 'correction')}"
    if not touches and not result.corrections:
        by = "without a touch"
    pushes = "the first push" if result.pushes == 1 else f"push {result.pushes}"
    then = (
        f", and {counted(presses, 'press', 'presses')} against the bore's walls told its exact pose" if presses else ""
    )
    depth = f"The peg sits {number(figures.insertion_depth_mm, 1)} mm deep in its hole: "
    felt = " The hole was found by force, though vision was asked." if figures.felt_for else ""
    return f"{depth}{pushes} went in {by}{then}.{felt}"
