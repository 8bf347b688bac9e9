"""Trains the first stage of a spec in a kernel, against the interpreter's losses and torch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs, reach
from msnn.model.model import Model
from msnn.model.weights.weights_file import initial_weights
from msnn.simulation.rollout import loss_sums
from msnn.training.engines.engine import Engine, LossSums, NonFiniteLossError, with_all_kept
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.optimizers import Sgd
from spec_schema.sections.training import Stage

STARTS = 11
"""One group of lanes and a part of one."""

LOSSES = 1e-9
"""Of a loss, kernel against interpreter. Rounding of float64 grows over a rollout of eight steps of
some hundred operations; every wrong operation changes a loss by far more."""

TRAINED = 1e-6
"""Of losses after two epochs, kernel against torch. Adam steps along rounding where a slope is 0,
which leave the losses as they are: of weights only those of plain gradient descent are compared."""

_STALLED = 0.1
"""Of a learning rate: Adam moves a number by about one each batch, less only along rounding."""

WEIGHTS = 1e-9
"""Of weights after two epochs of gradient descent, relative to their size or 0.01."""


_NAMES_NOTHING = "E0908"
"""What is said of a stage that names a parameter which the model does not keep."""

_NOTHING_LEARNED = {"E0904", "E0934"}
"""What is said of a stage without a parameter, or without a loss that depends on one."""


def stage_to_train(model: Model) -> StagePlan | None:
    """The first stage, if there is something to learn in it. SpecError where it is refused."""
    stage = model.spec.train[0]
    plan, refused = _planned(model, stage)
    if refused is not None and _NAMES_NOTHING in _codes(refused):
        # what a model keeps of its parameters is not known when its spec is drawn
        plan, refused = _planned(model, stage.model_copy(update={"freeze": (), "lr": {}}))
    if refused is not None and not _codes(refused) <= _NOTHING_LEARNED:
        raise refused
    return plan


def _planned(model: Model, stage: Stage) -> tuple[StagePlan | None, SpecError | None]:
    findings = Findings()
    plans = plan_stages(model.program, [stage], findings)
    try:
        findings.raise_errors()
    except SpecError as error:
        return None, error
    return plans[0], None


def _codes(error: SpecError) -> set[str]:
    return {found.code for found in error.diagnostics if found.severity == "error"}


def kernel_fault(plan: StagePlan) -> tuple[str, str] | None:
    """What is wrong with the training of a stage, in a word and in words, or None."""
    weights, (series, runs) = initial_weights(plan.program), _record(plan)
    native = NativeEngine(plan, series, weights, None, None)
    native._kernel.built.mark_checked()  # here two others judge it
    said = _of_sums(native.evaluate(runs), _judged(plan, series, runs, weights), LOSSES)
    if said is not None:
        return "losses", said
    torch = TorchEngine(plan, series, weights, None, None)
    found, wanted = _trained(native, runs), _trained(torch, runs)
    if found is None or wanted is None:
        return None if found is wanted else ("diverges", "one engine diverges, the other does not")
    said = _of_sums(native.evaluate(runs), torch.evaluate(runs), TRAINED)
    if said is not None:
        if not isinstance(plan.optimizer, Sgd) and _stalls(plan, weights, wanted):
            return None
        return "after epochs", said
    for name, value in wanted.items() if isinstance(plan.optimizer, Sgd) else ():
        scale = max(1e-2, float(np.abs(value).max(initial=0.0)))
        error = float(np.abs(found[name] - value).max(initial=0.0)) / scale
        if not error <= WEIGHTS:
            return "weights", f"{name} becomes {found[name].tolist()}, in torch {value.tolist()}"
    return None


def _stalls(
    plan: StagePlan, before: Mapping[str, FloatArray], after: Mapping[str, FloatArray]
) -> bool:
    """Whether some slope is 0 but for rounding, which Adam divides by itself: nothing compares."""
    least = _STALLED * (plan.lr or 0.0)
    return any(bool((np.abs(after[n] - before[n]) < least).any()) for n in plan.trained)


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


def _judged(
    plan: StagePlan, series: Mapping[str, FloatArray], runs: Runs, weights: Mapping[str, FloatArray]
) -> LossSums:
    kept = with_all_kept(series, plan.masks)
    with np.errstate(all="ignore"):
        judge = Interpreter(plan.program, weights)
        return loss_sums(judge, kept, runs, plan.rollout.skip)


def _of_sums(found: LossSums, wanted: LossSums, tolerance: float) -> str | None:
    for name, value in wanted.items():
        ours, least = found[name], tolerance * max(value.count, 1)
        near = np.isclose(ours.total, value.total, rtol=tolerance, atol=least, equal_nan=True)
        if ours.count != value.count or not near:
            return f"a kernel computes {name} = {ours}, not {value}"
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
