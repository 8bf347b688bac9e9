"""Steers by the predictive controller that the vehicle's spec is exported to."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from closed_loop import Seen

import msnn


@dataclass(frozen=True)
class Solve:
    """What the solver said at a sample."""

    status: str
    iterations: int
    taken: float  # s of the processor


class Predictive:
    """The C of the vehicle's `mpc` section, called from Python: it plans angles at every sample."""

    def __init__(self, spec: Path, settings: Sequence[str] = ()) -> None:
        weights = spec.parent / "runs" / "vehicle" / "latest"
        self._controller = msnn.mpc(msnn.load(str(spec), settings), str(weights), solver="c")
        self._horizon = self._controller.problem.horizon
        self.by = self._controller.solver
        self.solves: list[Solve] = []

    def start(self, seen: Seen) -> None:
        self._controller.reset(control={"delta": 0.0})  # a car that rolled straight on

    def steer(self, seen: Seen) -> float:
        began = time.thread_time()
        found = self._controller.solve(
            # what the vehicle predicts of a sample is the curvature of the next one
            references={"wanted": seen.path.curvature[1 : self._horizon + 2]},
            disturbances={
                "v": np.append(seen.speed, seen.path.speed[1 : self._horizon]),
                "a": seen.acceleration,
            },
        )
        taken = time.thread_time() - began
        self.solves.append(Solve(found.status.name, found.iterations, taken))
        return float(found.control["delta"])
