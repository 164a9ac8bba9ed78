"""Adam on NumPy arrays, so that the lessons need nothing else."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray


class Adam:
    """Kingma and Ba's optimiser, with bias correction; PyTorch's defaults.

    parameters: arrays, which `step` changes in place.
    """

    def __init__(
        self,
        parameters: "Iterable[NDArray[np.floating]]",
        rate: float = 1e-3,
        betas: "tuple[float, float]" = (0.9, 0.999),
        epsilon: float = 1e-8,
    ) -> None:
        self.parameters = list(parameters)
        self.rate, self.betas, self.epsilon = rate, betas, epsilon
        self.steps = 0
        self.first = [np.zeros_like(parameter) for parameter in self.parameters]
        self.second = [np.zeros_like(parameter) for parameter in self.parameters]

    def step(self, gradients: "Iterable[NDArray[np.floating]]") -> None:
        """One step down the gradients, one for each parameter; ValueError where there are more or fewer."""
        gradients = list(gradients)
        if len(gradients) != len(self.parameters):
            raise ValueError(f"Adam: {len(gradients)} gradients of {len(self.parameters)} parameters")
        self.steps += 1
        a, b = self.betas
        for parameter, gradient, first, second in zip(self.parameters, gradients, self.first, self.second):
            first += (1 - a) * (gradient - first)
            second += (1 - b) * (gradient * gradient - second)
            scale = np.sqrt(second / (1 - b**self.steps)) + self.epsilon
            parameter -= self.rate / (1 - a**self.steps) * first / scale
