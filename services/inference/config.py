"""The inference service's own settings."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from crosspih_common.config.section import Section


class InferenceConfig(Section):
    """The `inference` section of a cell's file."""

    seed: int = Field(default=0, ge=0, description="of the estimator's own draws; the same touches, the same answer")
    samples: int = Field(default=240, ge=40, description="starts drawn from the prior")
    starts: int = Field(default=8, ge=1, description="starts that are fitted to the end")
    friction_sd: float = Field(default=0.1, gt=0.0)
    prior_tail_degrees: float = Field(default=5.0, gt=0.0, description="how easily touches overrule vision")
    next_touch: Literal["pattern", "information"] = Field(
        default="pattern", description="a fixed pattern, or the push of most expected information"
    )
    estimator: str = Field(
        default="", description="module:function of your own that answers for the touches; empty: ours"
    )
    network: str = Field(
        default="", description="module:function of your own that answers inference/network; empty: the paper's network"
    )
    weights: str = Field(default="", description="the network's safetensors file; empty: the shipped one")
    sequence_weights: str = Field(default="", description="the sequence network's; empty: the shipped one")
