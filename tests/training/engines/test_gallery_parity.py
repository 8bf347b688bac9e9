"""Both engines train every spec of the gallery to the same losses, in one order of starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.model.load import load_model
from msnn.model.model_data import read_data
from msnn.model.weights.weights_file import initial_weights
from msnn.simulation.rollout import cost, loss_sums, moments
from msnn.training.engines.engine import LossSums
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.stages.monitor import loss_values
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.examples.gallery import NAMES, gallery_copy, spec_of

EPOCHS = 3
BATCH = 12
STARTS = 30
"""Three batches, the last one smaller: torch unrolls them step by step."""
TOLERANCES = {"float32": (1e-6, 1e-4), "float64": (1e-12, 1e-9)}
"""Of the first batch's losses at the same weights, where the data allow it (`blurred`), and of
those of epochs: steps along rounded gradients add to them."""

EXACT_IN_FLOAT32 = {"arm_friction", "battery", "engine_map", "lane_keeper"}
"""Where 1e-6 is more than the blur, so that it is what is asked."""


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


@pytest.mark.parametrize("dtype", TOLERANCES)
@pytest.mark.parametrize("name", NAMES)
def test_both_engines_train_alike(name: str, dtype: str, gallery: Path) -> None:
    require_tool("gcc", install="apt-get install gcc")
    model = load_model(spec_of(gallery, name), [f"train.0.dtype={dtype}"])
    findings = Findings()
    (plan,) = plan_stages(model.program, model.spec.train, findings)
    data = read_data(model, None, "training")
    found = stage_data(plan, data, findings)
    assert found is not None
    runs = found.train.take(np.arange(min(STARTS, len(found.train))))
    batch = runs.take(np.arange(min(BATCH, len(runs))))
    begin = initial_weights(model.program)
    sums: list[list[LossSums]] = []
    for make in (NativeEngine, TorchEngine):
        engine = make(plan, data.series, begin, found.train_rows, found.watched_rows)
        sums.append([engine.evaluate(batch)])
        for epoch in range(EPOCHS):
            engine.begin_epoch(epoch, 1.0)
            sums[-1].append(engine.train_batches(runs, BATCH))
    (first, *epochs), (torch_first, *torch_epochs) = (
        [loss_values(plan, each) for each in engine] for engine in sums
    )
    exact, trained = TOLERANCES[dtype]
    blur = blurred(plan, data.series, batch, begin, found.watched_rows, dtype)
    for name, value in torch_first.items():
        # each may be as far from the loss, on either side of it
        assert first[name] == pytest.approx(value, rel=max(exact, 2.0 * blur[name]))
    for ours, theirs in zip(epochs, torch_epochs, strict=True):
        assert ours == pytest.approx(theirs, rel=trained)


@pytest.mark.parametrize("name", NAMES)
def test_float32_is_as_close_to_float64_as_rounded_data_let_it(name: str, gallery: Path) -> None:
    """Both engines: none of them is the one that is off."""
    require_tool("gcc", install="apt-get install gcc")
    model = load_model(spec_of(gallery, name), ["train.0.dtype=float32"])
    findings = Findings()
    (plan,) = plan_stages(model.program, model.spec.train, findings)
    data = read_data(model, None, "training")
    found = stage_data(plan, data, findings)
    assert found is not None
    batch = found.train.take(np.arange(min(BATCH, len(found.train))))
    begin = initial_weights(model.program)
    judge = Interpreter(plan.program, begin)
    sums = loss_sums(judge, data.series, batch, plan.rollout.skip, found.watched_rows)
    exact = loss_values(plan, sums)
    blur = blurred(plan, data.series, batch, begin, found.watched_rows, "float32")
    assert (max(blur.values()) < 1e-6) == (name in EXACT_IN_FLOAT32)
    for make in (NativeEngine, TorchEngine):
        engine = make(plan, data.series, begin, found.train_rows, found.watched_rows)
        for loss, value in loss_values(plan, engine.evaluate(batch)).items():
            # 1e-6 beside it for what the steps before have rounded
            assert value == pytest.approx(exact[loss], rel=1e-6 + blur[loss])


def blurred(
    plan: StagePlan,
    series: Mapping[str, FloatArray],
    runs: Runs,
    weights: Mapping[str, FloatArray],
    rows: Mapping[str, BoolArray] | None,
    dtype: str,
) -> dict[str, float]:
    """How far each loss moves, relatively, when predictions and targets are rounded once.

    Σ(c(|e| + u(|p| + |y|)) − c(|e|)) / Σc(|e|), u half a unit in the last place and c the cost of
    an error e = p − y: an error is a small difference and has fewer digits than its two sides. No
    computation in this type knows the loss better.
    """
    u = float(np.finfo(dtype).eps) / 2
    losses = {loss.name: loss for loss in plan.program.losses}
    moved, whole = dict.fromkeys(losses, 0.0), dict.fromkeys(losses, 0.0)
    for moment in moments(Interpreter(plan.program, weights), series, runs, losses=True):
        if moment.number < plan.rollout.skip:
            continue
        for name, (prediction, target) in moment.values.losses.items():
            assert target is not None, "losses of the gallery compare"
            scored = ~np.isnan(target)
            if rows is not None:
                scored &= rows[name][moment.t].reshape(-1, *(1,) * (target.ndim - 1))
            p, y = prediction[scored], target[scored]
            loss, error = losses[name], np.abs(p - y)
            rounded = cost(loss, error + u * (np.abs(p) + np.abs(y)), None)
            moved[name] += float(np.sum(rounded - cost(loss, error, None)))
            whole[name] += float(np.sum(cost(loss, error, None)))
    return {name: moved[name] / whole[name] for name in losses}
