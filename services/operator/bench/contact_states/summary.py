"""How well the states were classified: shares with their intervals, confusion, calibration, and why the rule fails.
Pure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ContactClassifier
from services.operator.bench.contact_states.judged import CLASSIFIERS, Judged
from services.operator.bench.contact_states.labels import NONE
from services.operator.bench.contact_states.plan import RANDOM, STATE_NAMES
from services.operator.scoring.statistics import wilson95

NAMES = (*STATE_NAMES, NONE)
UNEQUAL = 2.0


def share_right(judged: Sequence[Judged], classifier: ContactClassifier) -> dict[str, Any]:
    """How many were named right, out of how many, and the Wilson interval at 95 %."""
    right = sum(one.right(classifier) for one in judged)
    if not judged:
        return {"right": 0, "of": 0}
    low, high = wilson95(right, len(judged))
    return {"right": right, "of": len(judged), "share": right / len(judged), "low": low, "high": high}


def confusion(judged: Sequence[Judged], classifier: ContactClassifier) -> NDArray[np.int64]:
    """(27, 27) counts: true state by row, named state by column, in the order of NAMES."""
    counts = np.zeros((len(NAMES), len(NAMES)), dtype=np.int64)
    for one in judged:
        counts[NAMES.index(one.contact.truth.name), NAMES.index(one.verdicts[classifier].name)] += 1
    return counts


def reliability(judged: Sequence[Judged], classifier: ContactClassifier, bins: int = 10) -> list[dict[str, float]]:
    """For each bin of the confidence given to a named state: how many, mean confidence, share right."""
    named = [one for one in judged if one.verdicts[classifier].name != NONE]
    rows = []
    for low in np.arange(bins) / bins:
        inside = [one for one in named if low < one.verdicts[classifier].confidence <= low + 1.0 / bins]
        if inside:
            rows.append(
                {
                    "of": len(inside),
                    "confidence": float(np.mean([one.verdicts[classifier].confidence for one in inside])),
                    "share": float(np.mean([one.right(classifier) for one in inside])),
                }
            )
    return rows


def calibration_error(judged: Sequence[Judged], classifier: ContactClassifier) -> float:
    """The mean distance between confidence and share right over the bins of `reliability`, weighted."""
    rows = reliability(judged, classifier)
    total = sum(row["of"] for row in rows)
    return sum(row["of"] * abs(row["confidence"] - row["share"]) for row in rows) / max(total, 1)


def axial_share(one: Judged) -> float:
    """n_z0 = |Fz| / |F| of the wrench as measured (Eq. 17)."""
    force = np.asarray(one.contact.result.wrench[:3])
    return float(abs(force[2]) / np.linalg.norm(force))


def why_wrong(one: Judged) -> str:
    """Why the rule did not name the true state, as one of a few reasons."""
    verdict = one.verdicts[ContactClassifier.RULE]
    truth = one.contact.truth
    forces = [force for _, _, force in truth.touching]
    if truth.name == NONE:
        return f"named a state, but truly {truth.reason}"
    several = len(forces) > 1
    unequal = several and max(forces) > UNEQUAL * min(forces)
    because = ", forces unequal by more than 2" if unequal else ", forces about equal" if several else ""
    if verdict.name != NONE:
        what = "the sense" if verdict.name[2] != truth.name[2] else "the count"
        if verdict.name[0] == truth.name[0]:
            what = "the arms" if what == "the count" else what
        return f"{what} wrong{because}"
    for begins, said in (
        ("n_z0", "n_z0 outside its band"),
        ("the signs", "signs that stand in no row"),
        ("Mz", "no sign of Mz"),
        ("|Mz/Fz|", "lever not that of a taper contact"),
        ("the lateral", "lateral force between two cases"),
        ("Fz", "Fz not pushing back"),
    ):
        if verdict.reason.startswith(begins):
            return f"none: {said}{because}"
    return f"none: other{because}"


def named_of_the_same_sense(judged: Sequence[Judged]) -> dict[str, int]:
    """Contacts of three arms that the likelihood classifies wrong: how many, and how many of them as another three or
    as the four of the same sense.
    """
    verdicts = [
        (one.contact.truth.name, one.verdicts[ContactClassifier.LIKELIHOOD].name)
        for one in judged
        if one.contact.truth.name[0] == "3" and not one.right(ContactClassifier.LIKELIHOOD)
    ]
    same = sum(said != NONE and said[0] in "34" and said[2] == true[2] for true, said in verdicts)
    return {"wrong": len(verdicts), "another_three_or_four_of_the_same_sense": same}


def summarise(judged: Sequence[Judged]) -> dict[str, Any]:
    """All figures of `crosspih bench states`: on purpose, at random, by state, by count and stiffness."""
    purposed = [one for one in judged if one.contact.result.target != RANDOM]
    drawn = [one for one in judged if one.contact.result.target == RANDOM]
    stiffnesses = sorted({one.contact.stiffness_n_mm for one in judged})

    def both(rows: Sequence[Judged]) -> dict[str, Any]:
        return {classifier.value: share_right(rows, classifier) for classifier in CLASSIFIERS}

    def kind(one: Judged) -> str:
        return one.contact.truth.name if one.contact.truth.name == NONE else one.contact.truth.name[0]

    def at(stiffness: float, among: Sequence[Judged]) -> list[Judged]:
        return [one for one in among if one.contact.stiffness_n_mm == stiffness]

    def made(rows: Sequence[Judged]) -> dict[str, int]:
        return dict(Counter(kind(one) for one in rows))

    counts = ("1", "2", "3", "4", NONE)
    wrong = [one for one in judged if not one.right(ContactClassifier.RULE)]
    return {
        "contacts": len(judged),
        "least_of_a_state": min(len(of_state(judged, name)) for name in STATE_NAMES),
        "on_purpose": both(purposed),
        "mean_over_states": {classifier.value: mean_over_states(purposed, classifier) for classifier in CLASSIFIERS},
        "by_state": {name: both(of_state(judged, name)) for name in NAMES},
        "by_stiffness": {
            f"{stiffness:g}": {
                count: both([one for one in at(stiffness, purposed) if kind(one) == count]) for count in counts
            }
            for stiffness in stiffnesses
        },
        "random": {
            f"{stiffness:g}": {"made": made(at(stiffness, drawn)), **both(at(stiffness, drawn))}
            for stiffness in stiffnesses
        },
        "none_of_26": dict(Counter(one.contact.truth.reason for one in judged if one.contact.truth.name == NONE)),
        "n_z0": {
            count: quantiles(np.array([axial_share(one) for one in judged if kind(one) == count])) for count in counts
        },
        "n_z0_median": {
            f"{stiffness:g}": {
                count: float(np.median(shares))
                for count in counts
                if (shares := [axial_share(one) for one in at(stiffness, judged) if kind(one) == count])
            }
            for stiffness in stiffnesses
        },
        "threes": named_of_the_same_sense(judged),
        "calibration_error": {classifier.value: calibration_error(purposed, classifier) for classifier in CLASSIFIERS},
        "reliability": {classifier.value: reliability(purposed, classifier) for classifier in CLASSIFIERS},
        "rule_wrong": dict(Counter(why_wrong(one) for one in wrong).most_common()),
        "confusion": {classifier.value: confusion(judged, classifier).tolist() for classifier in CLASSIFIERS},
    }


def mean_over_states(judged: Sequence[Judged], classifier: ContactClassifier) -> float:
    """The mean of the shares named right of the 26 states; a state without contacts is left out."""
    shares = [share_right(rows, classifier)["share"] for name in STATE_NAMES if (rows := of_state(judged, name))]
    return float(np.mean(shares)) if shares else 0.0


def of_state(judged: Sequence[Judged], name: str) -> list[Judged]:
    """The contacts with this true state."""
    return [one for one in judged if one.contact.truth.name == name]


def quantiles(values: Array) -> dict[str, float]:
    """5, 25, 50, 75 and 95 %; empty for no values."""
    if not len(values):
        return {}
    named = ("p5", "p25", "p50", "p75", "p95")
    return dict(zip(named, np.percentile(values, [5, 25, 50, 75, 95]).tolist(), strict=True))
