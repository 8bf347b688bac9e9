"""Trains a workload by msnn's kernel alone: each epoch is a shuffle, packed batches and one
call.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[3]))

from msnn_engine import MsnnEngine
from serve import serve

from backends.native.kernel import Kernel
from backends.native.variables import Method, Rule
from msnn.model.weights.weights_file import initial_weights


class MsnnKernel(MsnnEngine):
    """One workload; spec, data and starts are those of the engine."""

    def __init__(self, settings: dict[str, Any]) -> None:
        super().__init__("native", settings)
        self._kernel = Kernel(self.plan.rollout.program, "float32", settings.get("threads", 1))
        self._data = self._kernel.data(self.series)
        self._begin()

    def _begin(self) -> None:
        program = self.plan.rollout.program
        rates = {parameter.name: self.settings["lr"] for parameter in program.parameters}
        rule = Rule(method=Method.ADAM, beta1=0.9, beta2=0.999, epsilon=1e-8)
        self._variables = self._kernel.variables(rule, initial_weights(program), rates)

    def reset(self) -> None:
        super().reset()
        if hasattr(self, "_kernel"):
            self._begin()

    def epoch(self, fixed: bool) -> float:
        runs, order, batch = self.runs, self.order(fixed), self.settings["batch"]
        groups, bounds = self._kernel.batches(runs.t0, int(runs.steps[0]), batch, order)
        _, sums, counts = self._kernel.train(self._data, groups, bounds, self._variables, [1.0])
        return float(sums[0] / counts[0])


if __name__ == "__main__":
    serve(lambda text: MsnnKernel(json.loads(text)))
