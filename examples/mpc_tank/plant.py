"""Simulates the two tanks as they are: other laws and numbers than the model has, finer steps."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SAMPLE_TIME = 4.0  # s
STEPS = 80  # of Heun's method in a sample
NOISE = 0.05  # cm, standard deviation of a level sensor
SPILLS = 12.0  # cm, height of the upper tank
TOP = 11.0  # cm, where the upper level is to stay below


@dataclass
class Tanks:
    """The rig; `leaks` opens a valve below the lower tank."""

    levels: Array = field(default_factory=lambda: np.array([2.0, 2.0]))  # cm
    speed: float = 0.0  # of the pump, V
    leaks: float = 0.0  # cm/s at a level of 1 cm
    spilt: float = 0.0  # cm of the upper tank

    def step(self, volts: float) -> None:
        """Over one sample, with the pump's voltage held."""
        dt = SAMPLE_TIME / STEPS
        for _ in range(STEPS):
            state = np.array([*self.levels, self.speed])
            first = self._slopes(state, volts)
            second = self._slopes(state + dt * first, volts)
            state = state + dt * (first + second) / 2
            self.spilt += max(state[0] - SPILLS, 0.0)
            self.levels = np.clip(state[:2], 0.0, [SPILLS, np.inf])
            self.speed = float(state[2])

    def measured(self, random: np.random.Generator) -> Array:
        """Both levels with noise [cm]."""
        return self.levels + NOISE * random.standard_normal(2)

    def _slopes(self, state: Array, volts: float) -> Array:
        upper, lower, speed = np.maximum(state, 0.0)
        # the pump lags, starts late and gets weaker; outlets follow no exact root
        flow = 0.046 * max(speed - 0.4, 0.0) * (1 - 0.012 * speed)
        between, out = 0.083 * upper**0.53, 0.076 * lower**0.47
        leak = self.leaks * lower**0.5
        return np.array([flow - between, between - out - leak, (volts - speed) / 0.8])
