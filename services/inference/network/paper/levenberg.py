"""Levenberg-Marquardt for the one-hidden-layer network, after MATLAB's `trainlm` (Hagan and Menhaj 1994)."""

from __future__ import annotations

import torch

BLOCK = 512


class LevenbergMarquardt:
    """Full-batch Levenberg-Marquardt steps on Linear, Sigmoid, Linear in double precision.

    One `step` is one epoch of trainlm: solve (J^T J + mu I) dx = -J^T e; where the sum of squares falls take the step
    and divide mu by ten, else multiply it by ten and try again, up to mu_max. The Jacobian is never held whole: the
    normal equations are summed over blocks of contacts.
    """

    def __init__(
        self,
        layers: torch.nn.Sequential,
        mu: float = 1e-3,
        mu_decrease: float = 0.1,
        mu_increase: float = 10.0,
        mu_max: float = 1e10,
    ) -> None:
        hidden, output = layers[0], layers[2]
        if not (isinstance(hidden, torch.nn.Linear) and isinstance(output, torch.nn.Linear)):
            raise ValueError("LevenbergMarquardt wants Linear, Sigmoid, Linear")
        self._hidden, self._output = hidden, output
        self._layers = layers
        self.mu = mu
        self._decrease, self._increase, self._max = mu_decrease, mu_increase, mu_max

    def step(self, inputs: torch.Tensor, targets: torch.Tensor) -> tuple[float, bool]:
        """One epoch: (mean square error reached, whether a step could still be taken)."""
        with torch.no_grad():
            normal, gradient, error = self._normal_equations(inputs, targets)
            before = torch.nn.utils.parameters_to_vector(self._layers.parameters())
            unit = torch.eye(len(before), dtype=before.dtype)
            while self.mu <= self._max:
                factor, failed = torch.linalg.cholesky_ex(normal + self.mu * unit)
                if not bool(failed):
                    move = -torch.cholesky_solve(gradient[:, None], factor)[:, 0]
                    torch.nn.utils.vector_to_parameters(before + move, self._layers.parameters())
                    reached = float(torch.sum((self._layers(inputs) - targets) ** 2))
                    if reached < error:
                        self.mu *= self._decrease
                        return reached / targets.numel(), True
                self.mu *= self._increase
            torch.nn.utils.vector_to_parameters(before, self._layers.parameters())
            return error / targets.numel(), False

    def _normal_equations(
        self, inputs: torch.Tensor, targets: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, float]:
        """J^T J, J^T e and the sum of squares, in the order of the layers' parameters.

        Output k changes with the hidden weight (a, i) as w_ka s_a x_i, s the sigmoid's slope. The part common to all
        outputs, s_a x_i, is multiplied once, and the w's are factored out of the sums.
        """
        weight = self._output.weight
        outputs, neurons = weight.shape
        of = torch.cat([torch.arange(neurons).repeat_interleave(inputs.shape[1]), torch.arange(neurons)])
        hidden = len(of)
        common = torch.zeros(hidden, hidden, dtype=inputs.dtype)
        crossed = torch.zeros(hidden, neurons + 1, dtype=inputs.dtype)
        active_square = torch.zeros(neurons + 1, neurons + 1, dtype=inputs.dtype)
        hidden_error = torch.zeros(hidden, outputs, dtype=inputs.dtype)
        output_error = torch.zeros(neurons + 1, outputs, dtype=inputs.dtype)
        total = 0.0
        for x, t in zip(torch.split(inputs, BLOCK), torch.split(targets, BLOCK), strict=True):
            active = torch.sigmoid(self._hidden(x))
            error = self._output(active) - t
            slope = active * (1.0 - active)
            back = torch.cat([(slope[:, :, None] * x[:, None]).reshape(len(x), -1), slope], dim=1)
            ahead = torch.cat([active, torch.ones(len(x), 1, dtype=inputs.dtype)], dim=1)
            common += back.T @ back
            crossed += back.T @ ahead
            active_square += ahead.T @ ahead
            hidden_error += back.T @ error
            output_error += ahead.T @ error
            total += float(torch.sum(error**2))
        count = hidden + outputs * (neurons + 1)
        normal = torch.zeros(count, count, dtype=inputs.dtype)
        gradient = torch.zeros(count, dtype=inputs.dtype)
        normal[:hidden, :hidden] = common * (weight.T @ weight)[of][:, of]
        gradient[:hidden] = (hidden_error * weight.T[of]).sum(dim=1)
        for k in range(outputs):
            rows = torch.cat([
                hidden + k * neurons + torch.arange(neurons), torch.tensor([hidden + outputs * neurons + k])
            ])  # fmt: skip
            block = crossed * weight[k, of][:, None]
            normal[:hidden, rows] = block
            normal[rows, :hidden] = block.T
            normal[rows[:, None], rows] = active_square
            gradient[rows] = output_error[:, k]
        return normal, gradient, total
