"""Which rows are scored, by `skip_rows`, whatever engine computes the losses (R9)."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.validation.validate import validate
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series, in_blocks
from tests.training.engines.engine_losses import ENGINES, OPTIMIZERS, losses

START = {"a": np.array(0.5), "b": np.array(0.1)}
MODEL = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.1}
outputs:
  x_next: {expr: "a*x + b*u", predicts: "x[t+1]", unit: m}
"""


def free_run_errors(x: FloatArray, u: FloatArray, t0: int, steps: int) -> FloatArray:
    """Prediction − target of the rows t0+1 … t0+steps, the loop closed."""
    found, state = np.zeros(steps), x[t0]
    for k in range(steps):
        state = START["a"] * state + START["b"] * u[t0 + k]
        found[k] = state - x[t0 + k + 1]
    return found


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("horizon", ["4", "episode", "record"])
def test_first_rows_of_each_record_are_not_scored(
    horizon: str, engine: str, optimizer: str
) -> None:
    require_tool("gcc", install="apt install gcc")
    series = gain_series(50, seed=3)
    data = dataset(series, train=[30], val=[20])
    stage = f"rollout: {horizon}, skip_rows: 11, dtype: float64, optimizer: {optimizer}"
    trained, watched, _ = losses(MODEL, f"{stage}, engine: {engine}", data, START)
    for found, stride, begin, rows in ((trained, 1, 0, 30), (watched, 4, 30, 20)):
        total, count = 0.0, 0
        x, u = (series[name][begin : begin + rows] for name in ("x", "u"))
        steps = int(horizon) if horizon == "4" else rows - 1
        starts = range(0, rows - steps, stride) if horizon == "4" else [0]
        spans = [(t0, steps) for t0 in starts]
        reached = spans[-1][0] + steps
        if horizon == "4" and stride == 4 and reached < rows - 1:
            spans.append((reached, rows - 1 - reached))  # the rest of the record
        for t0, length in spans:
            errors = free_run_errors(x, u, t0, length)
            kept = errors[np.arange(t0 + 1, t0 + length + 1) >= 11]
            total, count = total + float(np.sum(kept**2)), count + len(kept)
        assert found["x_next"].count == count
        assert found["x_next"].total == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_of_a_whole_record_training_and_monitor_score_their_own_rows(engine: str) -> None:
    """A free run over all rows: a monitor that scored those to train on would judge nothing."""
    require_tool("gcc", install="apt install gcc")
    series = gain_series(50, seed=3)
    data = in_blocks(dataset(series, train=[50]), "val", slice(30, 45))
    stage = f"rollout: record, dtype: float64, engine: {engine}"
    trained, watched, _ = losses(MODEL, stage, data, START)
    errors = free_run_errors(series["x"], series["u"], 0, 49)
    rows = np.arange(1, 50)
    held_out = (rows >= 30) & (rows < 45)
    for found, kept in ((trained, errors[~held_out]), (watched, errors[held_out])):
        assert found["x_next"].count == len(kept)
        assert found["x_next"].total == pytest.approx(float(kept @ kept), rel=1e-12)


def test_metrics_leave_the_first_rows_of_each_record_out() -> None:
    checks = "validate:\n  - {of: x_next, skip_rows: 8 s}\n  - {of: x_next}\n"
    program, spec = gain(more=checks)
    series = gain_series(40, seed=1)
    report = validate(program, dataset(series, test=[25, 15]), spec.checks, START)
    late, every = report.rows
    assert (late.scored, every.scored) == (17 + 7, 24 + 14)
    error = np.array([free_run_errors(series["x"], series["u"], t, 1)[0] for t in range(39)])
    kept = np.concatenate([error[7:24], error[25 + 7 : 39]])
    assert late.value == pytest.approx(np.sqrt(np.mean(kept**2)), rel=1e-12)


def test_rollouts_that_are_skipped_whole_are_an_error() -> None:
    data = dataset(gain_series(40), train=[25, 15])
    with pytest.raises(SpecError, match="skip 30 leaves nothing of a horizon of 24 evaluations"):
        losses(MODEL, "rollout: {horizon: record, skip: 30}", data, START)
    program, spec = gain(more="validate:\n  - {of: x_next, rollout: {horizon: 30, skip: 26}}\n")
    with pytest.raises(SpecError, match="skip 26 leaves nothing of a horizon of 24 evaluations"):
        validate(program, dataset(gain_series(40), test=[25, 15]), spec.checks, START)


def test_records_that_are_skipped_whole_are_an_error() -> None:
    data = dataset(gain_series(40), train=[25, 15])
    with pytest.raises(SpecError, match="skips the first 30 rows of each record, the longest"):
        losses(MODEL, "skip_rows: 30", data, START)
