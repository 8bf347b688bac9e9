"""Steers by what was learned: the exported C of a spec, or filters that least squares found."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from closed_loop import Seen
from preview import LOOK

import msnn

Array = npt.NDArray[np.float64]


class Exported:
    """The C that `msnn export` writes of a spec, compiled for this machine, a step a sample."""

    def __init__(self, spec: Path, *, planned_speeds: bool) -> None:
        weights = spec.parent / "runs" / spec.name.split(".")[0] / "latest"
        self._stepper = msnn.stepper(msnn.load(str(spec)), str(weights))
        self.by = self._stepper.engine
        if self.by != "c":  # it would steer alike, but it is the C that is judged here
            raise SystemExit(f"the C of {spec.name} was not compiled: is gcc or clang installed?")
        self._planned_speeds = planned_speeds

    def start(self, seen: Seen) -> None:
        past = {"a": 0.0} if self._planned_speeds else {}
        self._stepper.reset(delta=0.0, **past)  # a car that rolled straight on

    def steer(self, seen: Seen) -> float:
        path = {"rho": seen.path.curvature}
        if self._planned_speeds:
            path["v_t"] = seen.path.speed
        found = self._stepper.step(v=seen.speed, a=seen.acceleration, **path)
        return float(found["steer"])


@dataclass(frozen=True)
class LeastSquares:
    """δ = Σ (b_i + c_i · v_i²) · ρ_i over the planned path."""

    weights: Array

    def start(self, seen: Seen) -> None:
        """Nothing is remembered."""

    def steer(self, seen: Seen) -> float:
        return float(_regressors(seen.path.speed, seen.path.curvature)[0] @ self.weights)


def fit_filters(drives: list[Mapping[str, Array]]) -> LeastSquares:
    """The filters that are nearest to what the driver asked for."""
    rows = [_regressors(drive["v"], drive["rho"]) for drive in drives]
    asked = [drive["delta"][: len(row)] for drive, row in zip(drives, rows, strict=True)]
    return LeastSquares(np.linalg.lstsq(np.vstack(rows), np.concatenate(asked), rcond=None)[0])


def fit_lead(drives: list[Mapping[str, Array]], wheelbase: float) -> int:
    """How many samples the curvature is later than the angle asked for, by least squares."""
    errors = np.zeros(LOOK)
    for drive in drives:
        rows = len(drive["rho"]) - LOOK
        for lead in range(LOOK):
            bent = np.arctan(wheelbase * drive["rho"][lead : rows + lead])
            errors[lead] += np.sum((drive["delta"][:rows] - bent) ** 2)
    return int(np.argmin(errors))


def _regressors(v: Array, curvature: Array) -> Array:
    windows = np.lib.stride_tricks.sliding_window_view
    rho, squares = windows(curvature, LOOK), windows(v, LOOK) ** 2
    return np.hstack((rho, rho * squares))
