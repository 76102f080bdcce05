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
        """J^T J, J^T e and the sum of squares, in the order of the layers' parameters."""
        weight = self._output.weight
        outputs, neurons = weight.shape
        count = sum(parameter.numel() for parameter in self._layers.parameters())
        normal = torch.zeros(count, count, dtype=inputs.dtype)
        gradient = torch.zeros(count, dtype=inputs.dtype)
        total = 0.0
        for x, t in zip(torch.split(inputs, BLOCK), torch.split(targets, BLOCK), strict=True):
            active = torch.sigmoid(self._hidden(x))
            error = self._output(active) - t
            slope = active * (1.0 - active)
            # d output_k / d (weight, bias) of the hidden layer; then those of output row k alone
            back = weight[None] * slope[:, None]
            jacobian = torch.zeros(len(x), outputs, count, dtype=inputs.dtype)
            first = neurons * x.shape[1]
            jacobian[:, :, :first] = (back[..., None] * x[:, None, None]).reshape(len(x), outputs, first)
            jacobian[:, :, first : first + neurons] = back
            begin = first + neurons
            for k in range(outputs):
                jacobian[:, k, begin + k * neurons : begin + (k + 1) * neurons] = active
                jacobian[:, k, begin + outputs * neurons + k] = 1.0
            flat = jacobian.reshape(-1, count)
            normal += flat.T @ flat
            gradient += flat.T @ error.reshape(-1)
            total += float(torch.sum(error**2))
        return normal, gradient, total
