"""Trains the stage of a workload's spec on one engine of msnn, as `msnn train` does.

python msnn_engine.py native|torch
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[3]))

import numpy as np
from numpy.typing import NDArray
from serve import Contender, clock, serve

from compiler.elaboration.compile import compile_spec
from msnn.data.rollout_rows import Runs
from msnn.model.weights.weights_file import initial_weights
from msnn.training.engines.engine import Engine
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.reading.reader import read_spec

FloatArray = NDArray[np.float64]


class MsnnEngine(Contender):
    """One workload on the native or the torch engine."""

    def __init__(self, engine: str, settings: dict[str, Any]) -> None:
        self._name = engine
        self.settings = settings
        started = time.perf_counter()
        path = Path(settings["spec"])
        spec = read_spec(str(path), path.read_text(encoding="utf-8")).spec
        program = compile_spec(spec).program
        findings = Findings()
        (plan,) = plan_stages(program, spec.train, findings)
        findings.raise_errors()
        self.plan = plan
        self.series = dict(np.load(settings["data"]))
        first, starts = settings["first"], settings["starts"]
        t0 = np.arange(first, first + starts)
        self.runs = Runs(t0, np.full(starts, settings["horizon"]), 0, len(t0))
        self._shuffles = 0
        self._engine = self._opened(plan, initial_weights(program))
        size = self.settings["batch"]
        first = self.runs.take(self.order(fixed=True)[:size])
        self._engine.train_batches(first, size)  # a new kernel is checked here
        self.build_seconds = time.perf_counter() - started
        self.reset()

    def _opened(self, plan: StagePlan, weights: dict[str, FloatArray]) -> Engine:
        if self._name == "native":
            from msnn.training.engines.native.native_engine import NativeEngine

            return NativeEngine(plan, self.series, weights, None, None)
        from msnn.training.engines.torch.torch_engine import TorchEngine

        return TorchEngine(plan, self.series, weights, None, None)

    def reset(self) -> None:
        self._engine = self._opened(self.plan, initial_weights(self.plan.rollout.program))

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        started = clock()
        losses = [self.epoch(fixed) for _ in range(count)]
        return clock() - started, losses

    def epoch(self, fixed: bool) -> float:
        order = self.order(fixed)
        (summed,) = self._engine.train_batches(self.runs, self.settings["batch"], order).values()
        return summed.total / summed.count

    def order(self, fixed: bool) -> NDArray[np.int64]:
        """The start rows of an epoch in whole batches, as nnodely takes them; in the data's order
        if `fixed`.
        """
        starts = len(self.runs)
        self._shuffles += 1
        order = np.arange(starts) if fixed else self._engine.order(starts, self._shuffles)
        return order[: starts - starts % self.settings["batch"]]

    def gradient(self, weights: dict[str, list[float]]) -> dict[str, list[float]]:
        program = self.plan.rollout.program
        shapes = {p.name: tuple(a.size for a in p.axes) for p in program.parameters}
        given = {name: np.array(values).reshape(shapes[name]) for name, values in weights.items()}
        batch = self.runs.take(self.order(fixed=True)[: self.settings["batch"]])
        found = (self._native if self._name == "native" else self._double)(given, batch)
        return {name: values.ravel().tolist() for name, values in found.items()}

    def _native(self, weights: dict[str, FloatArray], batch: Runs) -> dict[str, FloatArray]:
        from backends.native.kernel import Kernel
        from backends.native.variables import by_parameter, flat

        program = self.plan.rollout.program
        kernel = Kernel(program, "float32")
        data, groups = kernel.data(self.series), kernel.groups(batch.t0, batch.steps)
        found = kernel.losses(data, groups, flat(program, weights), [1.0])
        return by_parameter(program, found.gradient)

    def _double(self, weights: dict[str, FloatArray], batch: Runs) -> dict[str, FloatArray]:
        """The gradient by torch's own differentiation in float64, which shares nothing with the
        kernel.
        """
        import torch

        from backends.torch_module.module import build_module
        from msnn.training.engines.torch.torch_losses import batch_losses, scoring

        program = self.plan.rollout.program
        model = build_module(program, torch.float64)
        model.load_physical(weights)
        raws = {parameter.name: model.raw(parameter.name) for parameter in program.parameters}
        for raw in raws.values():
            raw.requires_grad_(True)
        sums = batch_losses(model, scoring(model, self.series, 0, None), batch)
        sums[program.losses[0].name].value(program.losses[0].measure).backward()
        return {name: np.asarray(raw.grad) for name, raw in raws.items()}


if __name__ == "__main__":
    serve(lambda text: MsnnEngine(sys.argv[1], json.loads(text)))
