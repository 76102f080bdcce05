"""The hole's pose from touches: robust maximum a posteriori over contact hypotheses."""

from services.inference.estimator.bore import BoreWalls
from services.inference.estimator.estimate import estimate_pose
from services.inference.estimator.insertion import InsertionJudgement, InsertionSettings, advise_insertion
from services.inference.estimator.observation import (
    ContactHypothesis,
    EstimatorSettings,
    HolePosePrior,
    HolePosterior,
    TouchObservation,
    TouchVerdict,
)
from services.inference.estimator.pressed import PressedEstimate, PressSettings, pressed_estimate
from services.inference.estimator.seated import NotSeated, final_estimate

__all__ = [
    "BoreWalls",
    "ContactHypothesis",
    "EstimatorSettings",
    "HolePosePrior",
    "HolePosterior",
    "InsertionJudgement",
    "InsertionSettings",
    "NotSeated",
    "PressSettings",
    "PressedEstimate",
    "TouchObservation",
    "TouchVerdict",
    "advise_insertion",
    "estimate_pose",
    "final_estimate",
    "pressed_estimate",
]
