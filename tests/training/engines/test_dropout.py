"""Dropout: random in training only, alike in both engines, keyed by seed, stage, epoch and run."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.training.engines.engine import factors_of, with_all_kept
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.train import TrainingOptions, train
from tests.conditions import require_tool
from tests.language.compiled import codes, compiled, evaluated
from tests.native.test_kernel import initial, log_of
from tests.training.cases import compiled as model_of
from tests.training.cases import dataset, gain_series
from tests.training.engines.test_engines import ENGINES, first_batch, planned, runs_of
from tests.training.starts.test_starts import Heard

NET = """
dims: {o: 3}
inputs: {x: m, u: N}
layers:
  h: {fir: {window: 4, out: o, dropout: 0.4}}
  m: {mlp: {hidden: 8, dropout: 0.25}}
  l: {linear: {dropout: 0.1}}
states: {s: {next: "0.5 * s + dropout(u, 0.3)", init: "dropout(x.meas, 0.2)"}}
outputs: {x_next: {expr: "0.1 * sum(h(u)) + m(x, u) + l(x) + 0.1 * s", predicts: "x[t+1]"}}
"""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


def plan_of(stage: str) -> tuple[Program, StagePlan, dict[str, FloatArray]]:
    program, plan = planned(NET, stage)
    return program, plan, log_of(program)


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-9), ("float32", 1e-4)])
def test_both_engines_leave_out_the_same(dtype: str, tolerance: float) -> None:
    program, plan, log = plan_of(f"rollout: 6, dtype: {dtype}, seed: 3")
    found: list[list[float]] = []
    for make in ENGINES.values():
        engine = make(plan, log, initial(program), None, None)
        losses: list[float] = []
        for epoch in range(3):
            engine.begin_epoch(epoch, 1.0)
            losses.append(engine.train_batches(runs_of(6), 20)["x_next"].total)
        found.append(losses)
    # losses before each step; float32 rounds differently in each engine
    assert found[0] == pytest.approx(found[1], rel=tolerance)
    assert len({round(loss, 6) for loss in found[0]}) == 3


def test_each_attempt_leaves_out_something_else_alike_in_both_engines() -> None:
    program, plan, log = plan_of("rollout: 6, dtype: float64, seed: 3")
    found: list[list[float]] = []
    for make in ENGINES.values():
        losses: list[float] = []
        for attempt in (0, 1, 2, 1):
            engine = make(plan, log, initial(program), None, None)
            engine.begin_epoch(4, 1.0, attempt)
            losses.append(engine.train_batches(first_batch(6), 20)["x_next"].total)
        assert losses[1] == losses[3]
        assert len(set(losses)) == 3
        found.append(losses)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_runs_of_a_stage_differ_by_what_they_leave_out(engine: str) -> None:
    """No initial value is drawn here: without dropout all runs would be the same."""
    stage = f"epochs: 2, batch: 100, dtype: float64, starts: 3, engine: {engine}"
    text = """msnn: 1
name: plain
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.1}
outputs: {x_next: {expr: "dropout(a*x + b*u, RATE)", predicts: "x[t+1]"}}
train:
"""
    for rate, runs in (("0", 1), ("0.3", 3)):
        program, spec = model_of(text.replace("RATE", rate) + f"  - {{{stage}}}\n")
        heard = Heard()
        data = dataset(gain_series(100), train=[60], val=[40])
        train(program, data, spec.train, TrainingOptions(runs=None), heard)
        # one batch: the order of starts, drawn anew for each run too, moves sums by rounding only
        totals = {round(event.total, 9) for event in heard.epochs if event.epoch == 1}
        assert len(heard.epochs) == 6
        assert len(totals) == runs


def test_lbfgs_on_a_kernel_and_on_torch() -> None:
    program, plan, log = plan_of("rollout: 4, dtype: float64, optimizer: {lbfgs: {iterations: 3}}")
    found: list[float] = []
    for made in ENGINES.values():
        engine = made(plan, log, initial(program), None, None)
        engine.begin_epoch(2, 1.0)
        found.append(engine.train_batches(first_batch(4), 20)["x_next"].total)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_what_is_watched_has_no_dropout(engine: str) -> None:
    program, plan, log = plan_of("rollout: 4, dtype: float64")
    opened = ENGINES[engine](plan, log, initial(program), None, None)
    opened.begin_epoch(0, 1.0)
    without, plain = planned(
        NET.replace("0.4", "0")
        .replace("0.25", "0")
        .replace("0.1}", "0}")
        .replace("0.3)", "0)")
        .replace("0.2)", "0)"),
        "rollout: 4, dtype: float64",
    )
    assert not plain.masks
    wanted = ENGINES[engine](plain, log, initial(without), None, None).evaluate(first_batch(4))
    found = opened.evaluate(first_batch(4))["x_next"].total
    assert found == pytest.approx(wanted["x_next"].total, rel=1e-13)
    assert opened.train_batches(first_batch(4), 20)["x_next"].total != pytest.approx(found)


def test_factors_depend_on_seed_stage_epoch_attempt_and_mask_only() -> None:
    _, plan, log = plan_of("seed: 3")
    assert [mask.rate for mask in plan.masks] == [0.4, 0.25, 0.1, 0.3, 0.2]
    again = factors_of(plan, log, 7)
    assert not np.array_equal(factors_of(plan, log, 7, 1)["dropout 1"], again["dropout 1"])
    for name, values in factors_of(plan, log, 7).items():
        np.testing.assert_array_equal(values, again[name])
        assert not np.array_equal(values, factors_of(plan, log, 8)[name])
    for other in (plan_of("seed: 4")[1], replace(plan, index=1)):
        assert not np.array_equal(factors_of(other, log, 7)["dropout 1"], again["dropout 1"])
    # with the same draws what a smaller rate leaves out a larger one would leave out too
    wide = [replace(mask, size=4, rate=0.2 + 0.1 * i) for i, mask in enumerate(plan.masks)]
    lost = [values == 0 for values in factors_of(replace(plan, masks=wide), log, 7).values()]
    for smaller, larger in combinations(lost, 2):
        assert (smaller & ~larger).any()


def test_the_expectation_is_kept() -> None:
    _, plan, _ = plan_of("seed: 3")
    many = {"x": np.zeros(40_000)}
    for mask in plan.masks:
        factors = factors_of(plan, many, 0)[mask.signal]
        assert set(np.unique(factors)) == {0.0, 1 / (1 - mask.rate)}
        # five standard deviations of a mean of so many draws
        spread = np.sqrt(mask.rate / (1 - mask.rate) / factors.size)
        assert np.mean(factors) == pytest.approx(1, abs=5 * spread)
    assert all(np.all(with_all_kept(many, plan.masks)[mask.signal] == 1) for mask in plan.masks)


def test_a_layer_that_is_frozen_leaves_nothing_out() -> None:
    _, plan, _ = plan_of('freeze: ["h.*", l.weight, l.bias]')
    assert [mask.rate for mask in plan.masks] == [0.25, 0.3, 0.2]
    _, plan, _ = plan_of('freeze: ["h.*", "m.*", "l.w*"]')
    assert [mask.rate for mask in plan.masks] == [0.1, 0.3, 0.2]


def test_elsewhere_dropout_is_its_operand() -> None:
    head = "inputs: {x: m}\noutputs: {y: "
    assert evaluated(head + '"2 * dropout(x, 0.5)"}', {"x": [3.0]}) == 6
    program = compiled(NET)
    log = log_of(program)
    rows = np.array([10])
    judge = Interpreter(program)
    step = judge.step(log, rows, judge.start(log, rows), losses=False)
    assert np.isfinite(step.outputs["x_next"]).all()


@pytest.mark.parametrize("share", ["1", "-0.1", "x"])
def test_a_share_that_cannot_be_left_out(share: str) -> None:
    found = codes(f'inputs: {{x: m}}\noutputs: {{y: "dropout(x, {share})"}}\n')
    assert found == (["E0309"] if share == "x" else ["E0312"])
