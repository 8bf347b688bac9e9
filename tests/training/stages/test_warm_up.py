"""Closed signals are read from the log while a rollout warms up (R2, R4)."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import FloatArray
from msnn.simulation.rollout import LossSum
from msnn.training.plans.stage_plan import plan_stages
from msnn.validation.validate import validate
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset, gain_series
from tests.training.engines.engine_losses import ENGINES, OPTIMIZERS, losses

MODEL = """
msnn: 1
name: settling
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.1, c: 0.2}
states: {h: {unit: m, init: 0, next: "0.6*h + 0.4*x"}}
outputs:
  y: {expr: "a*x + b*u + c*h", predicts: "x[t+1]", unit: m}
"""
AT_ONCE = """
msnn: 1
name: settling
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.1, c: 0.2}
states: {h: {unit: m, init: 0, next: "0.6*h + 0.4*x"}}
outputs:
  y: {expr: "a*x[t-1] + b*u[t-1] + c*h", predicts: "x[t]", unit: m}
"""
START = {"a": np.array(0.5), "b": np.array(0.1), "c": np.array(0.2)}
WARM = 5


def run_errors(x: FloatArray, u: FloatArray, t0: int, steps: int) -> FloatArray:
    """y − x[t+1] of the evaluations after the warm-up."""
    found: list[float] = []
    seen, h = x[t0], 0.0
    for k in range(steps):
        t = t0 + k
        y = 0.5 * seen + 0.1 * u[t] + 0.2 * h
        h = 0.6 * h + 0.4 * seen
        seen = x[t + 1] if k < WARM else y
        if k >= WARM:
            found.append(y - x[t + 1])
    return np.array(found)


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
@pytest.mark.parametrize("engine", ENGINES)
def test_engines_read_the_log_while_it_lasts(engine: str, optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    series = gain_series(70, seed=5)
    data = dataset(series, train=[40], val=[30])
    rollout = f"rollout: {{horizon: 12, warm_up: {WARM} s}}, dtype: float64"
    stage = f"{rollout}, optimizer: {optimizer}, engine: {engine}"
    trained, watched, _ = losses(MODEL, stage, data, START)
    for found, starts, last in ((trained, range(28), 39), (watched, [40, 52, 64], 69)):
        runs = [run_errors(series["x"], series["u"], t, min(12, last - t)) for t in starts]
        errors = np.concatenate(runs)
        assert found["y"].count == len(errors)
        assert found["y"].total == pytest.approx(float(np.sum(errors**2)), rel=1e-12)


def test_a_gradient_does_not_go_through_what_was_read() -> None:
    """One scored evaluation after the warm-up: its slope is that of a start from the log."""
    require_tool("gcc", install="apt install gcc")
    data = dataset(gain_series(40, seed=5), train=[7])
    steps: list[dict[str, FloatArray]] = []
    for engine in ENGINES:
        rollout = f"rollout: {{horizon: 6, warm_up: 5}}, dtype: float64, engine: {engine}"
        stage = f"{rollout}, optimizer: {{sgd: {{lr: 1, momentum: 0}}}}"
        steps.append(dict(losses(MODEL, stage, data, START)[2]))
    x, u = data.series["x"], data.series["u"]
    (error,) = run_errors(x, u, 0, 6)
    h = sum(0.4 * 0.6 ** (4 - k) * x[k] for k in range(5))
    slopes = {"a": x[5], "b": u[5], "c": h}
    for found in steps:
        for name, slope in slopes.items():
            expected = START[name] - 2 * error * slope
            assert found[name] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("model", [MODEL, AT_ONCE])
def test_a_warm_run_is_the_open_one_until_the_warm_up_ends(model: str) -> None:
    program, _ = compiled(model)
    series = gain_series(30, seed=2)
    warm = Interpreter(close_loop(program, ["x"], WARM)).rollout(series, 1, 25).outputs["y"][0]
    read = Interpreter(program).rollout(series, 1, 25).outputs["y"][0]
    fed_back = Interpreter(close_loop(program, ["x"])).rollout(series, 1, 25).outputs["y"][0]
    # what is predicted of the last sample that was read comes from the log alone
    assert np.array_equal(warm[: WARM + 1], read[: WARM + 1])
    assert not np.isclose(warm[WARM + 1], read[WARM + 1], rtol=1e-6)
    assert not np.isclose(warm[WARM + 1], fed_back[WARM + 1], rtol=1e-6)


def test_validation_scores_after_the_warm_up() -> None:
    rollout = f"{{horizon: record, warm_up: {WARM}}}"
    checks = f"validate:\n  - {{of: y, rollout: {rollout}}}\n  - {{of: y, rollout: record}}\n"
    program, spec = compiled(MODEL + checks)
    series = gain_series(30, seed=8)
    warm, cold = validate(program, dataset(series, test=[30]), spec.checks, START).rows
    errors = run_errors(series["x"], series["u"], 0, 29)
    assert (warm.scored, cold.scored) == (29 - WARM, 29)
    assert warm.value == pytest.approx(float(np.sqrt(np.mean(errors**2))), rel=1e-12)


def test_a_warm_up_that_leaves_nothing_is_an_error() -> None:
    with pytest.raises(SpecError, match="warm_up 5 leaves nothing of a horizon of 5"):
        losses(
            MODEL, "rollout: {horizon: 5, warm_up: 5}", dataset(gain_series(9), train=[9]), START
        )


def test_a_warm_up_without_closed_signals_is_a_warning() -> None:
    rollout = "{horizon: 5, warm_up: 2, close: []}"
    program, spec = compiled(f"{MODEL}train:\n  - {{rollout: {rollout}}}\n")
    findings = Findings()
    plan_stages(program, spec.train, findings)
    assert [found.code for found in findings.in_order] == ["W0806"]


def test_no_loss_is_summed_while_a_rollout_warms_up() -> None:
    """A last rollout that is shorter than the warm-up scores nothing."""
    data = dataset(gain_series(40, seed=5), train=[20], val=[17])
    stage = f"rollout: {{horizon: 12, warm_up: {WARM}}}, dtype: float64, engine: torch"
    watched = losses(MODEL, stage, data, START)[1]
    assert watched["y"] == LossSum(watched["y"].total, 12 - WARM)
