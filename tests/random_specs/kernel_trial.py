"""Trains the first stage of a spec in a kernel, against the interpreter's losses and torch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs, reach
from msnn.model.model import Model
from msnn.model.weights_file import initial_weights
from msnn.simulation.rollout import loss_sums
from msnn.training.engines.dropout_masks import with_all_kept
from msnn.training.engines.engine import Engine, NonFiniteLossError
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from spec_schema.diagnostics.diagnostic import Findings

STARTS = 11
"""One group of lanes and a part of one."""

LOSSES = 1e-9
"""Of a loss, kernel against interpreter. Rounding of float64 grows over a rollout of eight steps of
some hundred operations; every wrong operation changes a loss by far more."""

WEIGHTS = 1e-7
"""Of weights after two epochs, kernel against torch: slopes add the rounding of going back, and
adam divides small ones by their own size."""


def kernel_fault(model: Model) -> str | None:
    """What is wrong with the training of the first stage; None where nothing is."""
    findings = Findings()
    plans = plan_stages(model.program, model.spec.train, findings)
    if findings.failed or not plans or not plans[0].trained:
        return None
    plan = plans[0]
    weights, (series, runs) = initial_weights(plan.program), _record(plan)
    native = NativeEngine(plan, series, weights, None, None)
    native._kernel.built.mark_checked()  # here two others judge it
    said = _of_losses(plan, native, series, runs, weights)
    if said is not None:
        return said
    torch = TorchEngine(plan, series, weights, None, None)
    found, wanted = _trained(native, runs), _trained(torch, runs)
    if found is None or wanted is None:
        return None if found is wanted else "one engine diverges, the other does not"
    for name, value in wanted.items():
        scale = max(1e-2, float(np.abs(value).max(initial=0.0)))
        error = float(np.abs(found[name] - value).max(initial=0.0)) / scale
        if not error <= WEIGHTS:
            return (
                f"{name} is {found[name].ravel()[:4]} after a kernel's epochs, {value.ravel()[:4]}"
            )
    return None


def _record(plan: StagePlan) -> tuple[dict[str, FloatArray], Runs]:
    """Series of all signals, and rollouts in them."""
    random = np.random.Generator(np.random.Philox(1))
    horizon = plan.rollout.horizon
    assert isinstance(horizon, int)
    around = reach(plan.program)
    rows = around.rows(horizon) + STARTS
    masks = {mask.signal for mask in plan.masks}
    series = {
        signal.name: random.uniform(-1.5, 1.5, (rows, *(axis.size for axis in signal.axes)))
        for signal in plan.program.signals
        if signal.name not in masks
    }
    t0 = around.back + np.arange(STARTS)
    return series, Runs(t0, np.full(STARTS, horizon), 0, rows)


def _of_losses(
    plan: StagePlan,
    engine: NativeEngine,
    series: Mapping[str, FloatArray],
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> str | None:
    kept = with_all_kept(series, plan.masks)
    with np.errstate(all="ignore"):
        judge = Interpreter(plan.program, weights)
        wanted = loss_sums(judge, kept, runs, plan.rollout.skip)
    found = engine.evaluate(runs)
    for name, value in wanted.items():
        ours = found[name]
        same = ours.count == value.count and np.isclose(
            ours.total, value.total, rtol=LOSSES, atol=LOSSES * max(value.count, 1), equal_nan=True
        )
        if not same:
            return f"a kernel computes {name} = {ours}, the interpreter {value}"
    return None


def _trained(engine: Engine, runs: Runs) -> dict[str, FloatArray] | None:
    """The weights after two epochs; None where they diverge."""
    try:
        for epoch in range(2):
            engine.begin_epoch(epoch, 1.0)
            engine.train_batches(runs, 8)
    except NonFiniteLossError:
        return None
    return engine.weights()
