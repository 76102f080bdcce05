"""MATLAB's `traingdx`, gradient descent with momentum and an adaptive rate, as a torch optimiser."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch


class TrainGdx(torch.optim.Optimizer):
    """Gradient descent with momentum and adaptive learning rate over the full batch.

    One `step(closure)` is one epoch as in MATLAB's Neural Network Toolbox (R2022b, traingdx): take dX = mc dX_prev +
    lr (1 - mc) dE/dX. If the error grows by more than `max_perf_inc`, throw the step away, lower the rate by `lr_dec`
    and forget the momentum; else keep it, and if the error fell raise the rate by `lr_inc`.
    """

    def __init__(
        self,
        parameters: Iterable[torch.nn.Parameter],
        lr: float = 0.01,
        momentum: float = 0.9,
        lr_inc: float = 1.05,
        lr_dec: float = 0.7,
        max_perf_inc: float = 1.04,
    ) -> None:
        defaults = {
            "lr": lr, "momentum": momentum, "lr_inc": lr_inc, "lr_dec": lr_dec, "max_perf_inc": max_perf_inc,
        }  # fmt: skip
        super().__init__(parameters, defaults)
        if len(self.param_groups) != 1:
            raise ValueError("TrainGdx wants one parameter group: its rate belongs to the whole error")

    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """One epoch. closure() clears the gradients, computes the error, calls backward and returns it."""
        if closure is None:
            raise ValueError("TrainGdx.step wants a closure that returns the error: it has to judge its own step")
        group = self.param_groups[0]
        parameters: list[torch.nn.Parameter] = group["params"]
        with torch.enable_grad():
            error = float(closure())
        gradients = [torch.zeros_like(p) if p.grad is None else p.grad.clone() for p in parameters]
        before = [p.detach().clone() for p in parameters]
        moves = []
        with torch.no_grad():
            for parameter, gradient in zip(parameters, gradients, strict=True):
                last = self.state[parameter].get("move", torch.zeros_like(parameter))
                move = group["momentum"] * last - group["lr"] * (1.0 - group["momentum"]) * gradient
                parameter.add_(move)
                moves.append(move)
        with torch.enable_grad():
            reached = float(closure())
        if reached > error * group["max_perf_inc"]:
            with torch.no_grad():
                for parameter, old in zip(parameters, before, strict=True):
                    parameter.copy_(old)
                    self.state[parameter]["move"] = torch.zeros_like(parameter)
            group["lr"] *= group["lr_dec"]
            return error
        if reached < error:
            group["lr"] *= group["lr_inc"]
        for parameter, move in zip(parameters, moves, strict=True):
            self.state[parameter]["move"] = move
        return reached
