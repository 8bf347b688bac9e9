"""Steers by rules that need no learning: the kinematic car, Stanley's, and one that explores."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from closed_loop import Controller, Seen
from setting import SAMPLE_TIME

Array = npt.NDArray[np.float64]


@dataclass
class Kinematic:
    """δ = atan(wheelbase · curvature), of the path so many samples ahead."""

    wheelbase: float
    ahead: int

    def start(self, seen: Seen) -> None:
        """Nothing is remembered."""

    def steer(self, seen: Seen) -> float:
        return float(np.arctan(self.wheelbase * seen.path.curvature[self.ahead]))


@dataclass
class Stanley:
    """δ = -ψ - atan(k · e / v), e of the front axle (Hoffmann et al., ACC 2007).

    The heading that a steady bend needs and the damping of the yaw rate are those of the paper.
    """

    wheelbase: float
    to_front: float
    slip: float  # rad s²/m, side slip of the rear axle for a lateral acceleration
    gain: float = 2.5  # 1/s
    damping: float = 0.1  # s

    def start(self, seen: Seen) -> None:
        """Nothing is remembered."""

    def steer(self, seen: Seen) -> float:
        v, place = seen.speed, seen.place
        offset = place.offset + self.to_front * np.sin(seen.heading)
        bend = v * place.curvature  # yaw rate of the road
        steady = (
            np.arctan((self.wheelbase - self.to_front) * place.curvature) - self.slip * v * bend
        )
        angle = -(seen.heading + steady) - np.arctan(self.gain * offset / (1.0 + v))
        return float(
            angle
            + np.arctan(self.wheelbase * place.curvature)
            + self.damping * (bend - seen.yaw_rate)
        )


@dataclass
class Exploring:
    """Another driver, with waves on his steering that show what the car does."""

    driver: Controller
    seed: int
    size: float  # rad, root mean square at 10 m/s; it falls with the square of the speed
    _step: int = 0
    _phases: Array = field(default_factory=lambda: np.zeros(0))

    FREQUENCIES = (0.15, 0.31, 0.53, 0.83, 1.27, 1.91, 2.7)  # Hz

    def start(self, seen: Seen) -> None:
        random = np.random.default_rng(self.seed)
        self._phases = random.uniform(0, 2 * np.pi, size=len(self.FREQUENCIES))
        self._step = 0
        self.driver.start(seen)

    def steer(self, seen: Seen) -> float:
        angles = 2 * np.pi * np.array(self.FREQUENCIES) * SAMPLE_TIME * self._step + self._phases
        self._step += 1
        wave = np.sqrt(2 / len(self.FREQUENCIES)) * np.sum(np.sin(angles))
        return self.driver.steer(seen) + float(
            self.size * (10.0 / max(seen.speed, 8.0)) ** 2 * wave
        )
