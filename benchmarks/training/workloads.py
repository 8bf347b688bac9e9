"""The four models to train, and synthetic logs for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Log = dict[str, NDArray[np.float64]]

SAMPLE_TIME = 0.05
SPECS = Path(__file__).parent / "specs"


@dataclass(frozen=True, slots=True)
class Workload:
    """A model to train, with its data, rollouts and settings."""

    letter: str
    name: str
    taps: int
    """Samples of the longest window; the first start has that many behind it."""
    horizon: int
    lr: float
    operations: int
    """Floating-point operations a sample and step: forward, adjoint, gradient of the weights."""
    weights: Mapping[str, tuple[int, float]]
    """Number of elements of each parameter, and a size of them that keeps rollouts finite."""

    def first_start(self) -> int:
        return self.taps - 1

    def starts(self, windows: int) -> int:
        """The number of rollouts that end inside the data, as nnodely counts them."""
        return windows - (self.horizon - 1)

    def whole(self, windows: int, batch: int) -> int:
        """The number of rollouts in complete batches; nnodely omits the others."""
        starts = self.starts(windows)
        return starts - starts % batch

    def settings(self, data: Path, windows: int, batch: int) -> dict[str, Any]:
        """The values that a tool must know to train the workload, as JSON values."""
        return {
            "name": self.name,
            "spec": str(SPECS / f"{self.name}.msnn.yaml"),
            "data": str(data),
            "sample_time": SAMPLE_TIME,
            "first": self.first_start(),
            "starts": self.starts(windows),
            "horizon": self.horizon,
            "batch": batch,
            "lr": self.lr,
            "weights": self.weights,
        }


# Operations: 2 for each multiply-add; a filter of n taps takes n of them forward, n for the
# gradient of its taps and, where its input is fed back, n for the adjoint of the input.
_FED_BACK, _GIVEN = 6, 4
_MASS = {"h_x.weight": (20, 0.02), "h_F.weight": (20, 0.02)}
_VEHICLE = {
    "h_v.weight": (30, 0.01),
    "h_brake.weight": (30, 0.1),
    "pedal.weight": (150, 0.1),
    "c0": (1, 0.1),
    "c1": (1, 1e-4),
}
_STEERING = {"W": (240, 0.01), "w0": (29, 0.01)}
_FUZZY = 100  # memberships of five sets and their slopes, about

WORKLOADS: Mapping[str, Workload] = {
    w.letter: w
    for w in (
        Workload("a", "feed_forward", 20, 1, 1e-3, 40 * _GIVEN, _MASS),
        Workload("b", "closed_loop", 20, 51, 1e-4, 20 * (_FED_BACK + _GIVEN), _MASS),
        Workload("c", "vehicle", 30, 31, 1e-4, 30 * (_FED_BACK + 6 * _GIVEN) + _FUZZY, _VEHICLE),
        # two sets of eight are active in each of both filters; understeer and preview are 30 each
        Workload(
            "d", "steering", 30, 80, 1e-4, 29 * 6 + 60 * 4 + 60 * 4 + 30 * 6 + _FUZZY, _STEERING
        ),
    )
}


def log(workload: Workload, windows: int) -> Log:
    """Synthetic data with that many rollouts, including the target one sample ahead."""
    rows = windows + workload.taps
    match workload.name:
        case "vehicle":
            return _vehicle(rows)
        case "steering":
            return _steering(windows + 2 * workload.taps - 2)
        case _:
            return _mass(rows)


def _mass(rows: int) -> Log:
    """A mass on a spring under a smooth random force, by semi-implicit Euler steps."""
    force = np.sin(0.1 * np.cumsum(np.random.default_rng(0).normal(size=rows)))
    position = np.zeros(rows)
    speed = 0.0
    for t in range(rows - 1):
        speed += SAMPLE_TIME * (force[t] - 2.0 * position[t] - 0.5 * speed)
        position[t + 1] = position[t] + SAMPLE_TIME * speed
    return {"x": position, "F": force}


def _vehicle(rows: int) -> Log:
    """A vehicle under random pedal and brake, with drag that grows with the square of its speed."""
    random = np.random.default_rng(1)
    pedal, brake = (np.abs(np.sin(0.05 * np.cumsum(random.normal(size=rows)))) for _ in range(2))
    speed = np.zeros(rows)
    for t in range(rows - 1):
        drag = 0.002 * speed[t] ** 2 + 0.1 * speed[t]
        speed[t + 1] = max(0.0, speed[t] + SAMPLE_TIME * (10 * pedal[t] - 6 * brake[t] - drag))
    return {"v": speed, "u": pedal, "brake": brake}


def _steering(rows: int) -> Log:
    """Data of a car that follows a winding road at changing speed, steered as if it had no mass."""
    time = SAMPLE_TIME * np.arange(rows)
    speed = 16 + 6 * np.sin(0.2 * time)
    bends = np.sin(0.1 * np.cumsum(np.random.default_rng(2).normal(size=rows)))
    curvature = 3.0 * bends / speed**2
    angle = curvature * (2.6 + 0.003 * speed**2)
    return {"v": speed, "a": 1.2 * np.cos(0.2 * time), "rho": curvature, "delta": angle}
