"""Both engines train the same models to the same losses, and stages choose between them."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import Engine
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.reading.reader import read_spec
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of

ENGINES: Mapping[str, type[NativeEngine | TorchEngine]] = {
    "native": NativeEngine,
    "torch": TorchEngine,
}
OPTIMIZERS = {
    "adam": "optimizer: {adam: {lr: 0.01}}",
    "adam decay clip": "optimizer: {adam: {lr: 0.01}}, weight_decay: 0.01, clip: 0.05",
    "adamw": "optimizer: {adamw: {lr: 0.01}}, weight_decay: 0.05",
    "sgd": "optimizer: {sgd: {lr: 0.001, momentum: 0.8}}",
}


def planned(text: str, stage: str) -> tuple[Program, StagePlan]:
    program = compiled(text)
    spec = f"msnn: 1\nname: test\nsample_time: 0.1 s\n{text}train:\n  - {{{stage}}}\n"
    findings = Findings()
    (plan,) = plan_stages(program, read_spec("test.yaml", spec).spec.train, findings)
    findings.raise_errors()
    return program, plan


BATCH = 20
"""Of 50 rollouts: the last batch is smaller."""


def runs_of(steps: int) -> Runs:
    starts = np.random.default_rng(2).permutation(np.arange(10, 60))
    return Runs(starts, np.full(len(starts), steps, dtype=np.int64), 0, 90)


def first_batch(steps: int) -> Runs:
    return runs_of(steps).take(np.arange(BATCH))


def trained(
    engine: Engine, runs: Runs, epochs: int
) -> tuple[list[dict[str, float]], dict[str, FloatArray]]:
    losses: list[dict[str, float]] = []
    for _ in range(epochs):
        sums = engine.train_batches(runs, BATCH)
        losses.append({name: value.total / value.count for name, value in sums.items()})
    return losses, engine.weights()


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
@pytest.mark.parametrize("model", MODELS)
def test_both_engines_train_alike(model: str, optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    text, _ = MODELS[model]
    # per-epoch losses of three epochs in the same order; float32 rounds differently in each engine
    for dtype, tolerance in (("float64", 1e-9), ("float32", 1e-4)):
        program, plan = planned(
            text, f"rollout: {{horizon: 8, skip: 2}}, dtype: {dtype}, {OPTIMIZERS[optimizer]}"
        )
        log = log_of(program)
        found = {
            name: trained(make(plan, log, initial(program), None, None), runs_of(8), 3)
            for name, make in ENGINES.items()
        }
        (native, native_weights), (torch, torch_weights) = found["native"], found["torch"]
        for ours, theirs in zip(native, torch, strict=True):
            assert ours == pytest.approx(theirs, rel=tolerance)
        for name, weight in torch_weights.items():
            scale = max(float(np.abs(weight).max()), 1e-2)
            np.testing.assert_allclose(native_weights[name], weight, atol=20 * tolerance * scale)


BOUNDED = """
dims: {three: 3}
inputs: {u: {}}
targets: {z: {}}
parameters:
  above: {init: 0.3, min: -0.05, scale: 2}
  below: {init: 0.3, max: 0.7, scale: 3}
  between: {init: 0.3, min: -0.05, max: 0.8}
  scaled: {init: 0.3, scale: 3}
  at: {init: [0.3, -0.05, 0.1], min: -0.05, dims: [three]}
outputs: {y: {expr: "(above + below + between + scaled + sum(at)) * u", predicts: z}}
"""


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("engine", ENGINES)
def test_training_begins_at_the_given_weights_to_the_bit(engine: str, dtype: str) -> None:
    """The map of the raw variable rounds: a value on the limit of a `clip` would be beside it."""
    require_tool("gcc", install="apt install gcc")
    program, plan = planned(BOUNDED, f"dtype: {dtype}, optimizer: {{sgd: {{lr: 0.01}}}}")
    random = np.random.default_rng(5)
    for _ in range(8):
        given = {name: random.uniform(-0.04, 0.7, w.shape) for name, w in initial(program).items()}
        given["at"][1] = -0.05  # a value on a bound is moved off it, the others are not
        made = ENGINES[engine](plan, log_of(program), given, None, None)
        began, start = made.weights(), made.state()
        assert made.moved == ("at",)
        assert -0.05 < began["at"][1] < -0.0499
        for name, weight in given.items():
            kept = weight.astype(dtype) == began[name]
            assert kept.sum() == weight.size - (name == "at"), name
        made.train_batches(runs_of(1), BATCH)
        assert np.any(made.weights()["between"] != began["between"])
        made.restore(start)
        assert all(np.array_equal(made.weights()[name], began[name]) for name in given)


@pytest.mark.parametrize("optimizer", ["adam: {lr: 0.01}", "lbfgs: {iterations: 4}"])
def test_threads_of_a_stage_change_no_bit(optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    text, _ = MODELS["vehicle"]
    found: list[dict[str, FloatArray]] = []
    for threads in (1, 3):
        program, plan = planned(text, f"rollout: 8, threads: {threads}, optimizer: {{{optimizer}}}")
        engine = NativeEngine(plan, log_of(program), initial(program), None, None)
        found.append(trained(engine, runs_of(8), 2)[1])
    for name, weight in found[0].items():
        np.testing.assert_array_equal(found[1][name], weight)


@pytest.mark.parametrize("model", MODELS)
def test_lbfgs_of_a_kernel_takes_the_steps_of_torch(model: str) -> None:
    require_tool("gcc", install="apt install gcc")
    text, _ = MODELS[model]
    program, plan = planned(text, "rollout: 8, dtype: float64, optimizer: {lbfgs: {iterations: 6}}")
    log = log_of(program)
    (native, _), (torch, _) = (
        trained(engine(plan, log, initial(program), None, None), first_batch(8), 3)
        for engine in ENGINES.values()
    )
    for ours, theirs in zip(native, torch, strict=True):
        # a line search decides on differences of losses, so that rounding grows over iterations
        assert ours == pytest.approx(theirs, rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_first_batch_losses_agree(model: str) -> None:
    require_tool("gcc", install="apt install gcc")
    text, _ = MODELS[model]
    for dtype, tolerance in (("float64", 1e-12), ("float32", 1e-6)):
        program, plan = planned(text, f"rollout: 8, dtype: {dtype}")
        log = log_of(program)
        runs = first_batch(8)
        sums = [
            make(plan, log, initial(program), None, None).evaluate(runs)
            for make in ENGINES.values()
        ]
        for name in sums[0]:
            ours, theirs = (s[name].total / s[name].count for s in sums)
            assert ours == pytest.approx(theirs, rel=tolerance)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_evaluation_is_of_the_rollouts_it_is_given(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    program, plan = planned(MODELS["arm"][0], "rollout: 8, dtype: float64")
    opened = ENGINES[engine](plan, log_of(program), initial(program), None, None)
    some, others = first_batch(8), first_batch(5)
    found = [opened.evaluate(runs) for runs in (some, others, some, first_batch(8))]
    assert found[0] == found[2] == found[3] != found[1]


def test_frozen_parameters_and_factors_of_the_learning_rate() -> None:
    require_tool("gcc", install="apt install gcc")
    text, _ = MODELS["fir"]
    program, plan = planned(text, 'rollout: 4, freeze: h_x.*, lr: {"h_F.*": 0.5}')
    weights = initial(program)
    results = [
        trained(make(plan, log_of(program), weights, None, None), runs_of(4), 2)[1]
        for make in ENGINES.values()
    ]
    for result in results:
        np.testing.assert_array_equal(result["h_x.weight"], weights["h_x.weight"])
        assert np.all(result["h_F.weight"] != weights["h_F.weight"])
    np.testing.assert_allclose(results[0]["h_F.weight"], results[1]["h_F.weight"], rtol=1e-5)


def test_a_stage_says_why_it_runs_on_torch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from msnn.training.engines.open_engine import open_engine
    from msnn.training.plans.stage_data import StageData
    from spec_schema.diagnostics.diagnostic import SpecError

    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.delenv("CC", raising=False)
    text, _ = MODELS["fir"]
    runs = first_batch(4)
    data = StageData(
        train=runs, train_rows=None, watched=runs, watched_rows=None, watched_set="train"
    )
    program, plan = planned(text, "rollout: 4")
    opened = open_engine(plan, log_of(program), initial(program), data)
    assert isinstance(opened.engine, TorchEngine)
    assert [note.code for note in opened.notes] == ["W0905"]
    _, plan = planned(text, "rollout: 4, engine: native")
    with pytest.raises(SpecError, match="install gcc, clang or"):
        open_engine(plan, log_of(program), initial(program), data)
