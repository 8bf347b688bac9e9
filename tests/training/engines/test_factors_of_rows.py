"""`rows:` of a loss: Σ w·cost / Σ w in every engine, and what is refused (R9)."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.standard_errors import StandardErrors, standard_errors
from msnn.training.train import TrainingOptions, train
from msnn.validation.validate import validate
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset, gain_series
from tests.training.engines.engine_losses import ENGINES, OPTIMIZERS, losses

MODEL = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {x: m, u: m}
targets: {z: m, w: 1}
parameters: {a: 0.5, b: 0.1}
outputs:
  y: {expr: "a*x + b*u", predicts: "x[t+1]", unit: m}
"""
START = {"a": np.array(0.5), "b": np.array(0.1)}
COSTS = {
    "mse": lambda e: e**2,
    "rmse": lambda e: e**2,
    "mae": np.abs,
    "huber": lambda e: np.where(np.abs(e) <= 1, e**2 / 2, np.abs(e) - 0.5),
}

MEASURED = [
    (measure, optimizer)
    for measure in COSTS
    for optimizer in OPTIMIZERS
    if measure in ("mse", "huber") or "marquardt" not in optimizer
]


def series(rows: int = 40) -> dict[str, FloatArray]:
    """Errors on both sides of 1, a missing target, rows that do not count, a sum below 1."""
    random = np.random.default_rng(4)
    found = gain_series(rows, seed=4)
    z = 3 * random.normal(size=rows)
    z[7] = np.nan
    w = random.uniform(0, 0.04, rows)
    w[[3, 11, 12]] = 0.0
    return {**found, "z": z, "w": w}


def scored(data: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors, factors and log(…, …) slopes of the evaluations that count, one step each."""
    t = np.arange(len(data["x"]) - 1)
    error = 0.5 * data["x"][t] + 0.1 * data["u"][t] - data["z"][t]
    kept = ~np.isnan(error) & (data["w"][t] > 0)
    slopes = np.stack([data["x"][t], data["u"][t]], axis=1)
    return error[kept], data["w"][t][kept], slopes[kept]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("measure", "optimizer"), MEASURED)
def test_a_loss_is_the_weighted_mean_of_its_rows(measure: str, engine: str, optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    data = series()
    model = f'{MODEL}losses: {{fit: {{expr: "{measure}(y, z)", rows: w}}}}\n'
    stage = f"dtype: float64, optimizer: {optimizer}, engine: {engine}"
    trained, watched, _ = losses(model, stage, dataset(data, train=[40]), START)
    error, factor, _ = scored(data)
    assert factor.sum() < 1
    for found in (trained, watched):
        assert found["fit"].count == pytest.approx(float(factor.sum()), rel=1e-12)
        total = float(np.sum(factor * COSTS[measure](error)))
        assert found["fit"].total == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("measure", ["mse", "rmse"])
def test_the_gradient_is_that_of_the_weighted_mean(measure: str, engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    data = series()
    model = f'{MODEL}losses: {{fit: {{expr: "{measure}(y, z)", rows: w}}}}\n'
    stage = f"dtype: float64, optimizer: {{sgd: {{lr: 1, momentum: 0}}}}, engine: {engine}"
    moved = losses(model, stage, dataset(data, train=[40]), START)[2]
    error, factor, slopes = scored(data)
    slope = 2 * (factor * error) @ slopes / factor.sum()
    if measure == "rmse":
        slope /= 2 * np.sqrt(np.sum(factor * error**2) / factor.sum())
    for name, one in zip(("a", "b"), slope, strict=True):
        assert START[name] - moved[name] == pytest.approx(one, rel=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_levenberg_marquardt_reaches_the_weighted_least_squares(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    data = series()
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: w}}}}\n'
    stage = f"train:\n  - {{optimizer: {{levenberg_marquardt: {{}}}}, engine: {engine}}}\n"
    program, spec = compiled(model + stage)
    found = train(program, dataset(data, train=[40]), spec.train, TrainingOptions(runs=None))
    error, factor, slopes = scored(data)
    target = slopes @ [0.5, 0.1] - error
    root = np.sqrt(factor)
    expected, *_ = np.linalg.lstsq(root[:, None] * slopes, root * target, rcond=None)
    assert [found.weights["a"], found.weights["b"]] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
def test_standard_errors_are_those_of_weighted_least_squares(scale: float) -> None:
    """They count rows, not factors: twice as large factors say nothing new."""
    require_tool("gcc", install="apt install gcc")
    data = series()
    error, factor, slopes = scored(data)
    root = np.sqrt(factor)
    design, target = root[:, None] * slopes, root * (slopes @ [0.5, 0.1] - error)
    best, *_ = np.linalg.lstsq(design, target, rcond=None)
    rest = target - design @ best
    variance = np.sum(rest**2) / (len(rest) - 2) * np.linalg.inv(design.T @ design)
    weights = {"a": np.array(best[0]), "b": np.array(best[1])}
    found = _standard_errors({**data, "w": scale * data["w"]}, weights)
    assert found.residuals == len(rest)
    expected = np.sqrt(np.diagonal(variance))
    assert [found.errors["a"], found.errors["b"]] == pytest.approx(expected, rel=1e-8)


def _standard_errors(data: dict[str, FloatArray], weights: dict[str, FloatArray]) -> StandardErrors:
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: w}}}}\ntrain: [{{epochs: 1}}]\n'
    program, spec = compiled(model)
    (plan,) = plan_stages(program, spec.train, Findings())
    return standard_errors(plan, dataset(data, train=[40]), weights)


def test_a_measured_loss_has_its_factors() -> None:
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: "where(w > 0.02, 2, 0)"}}}}\n'
    program, spec = compiled(f"{model}validate:\n  - {{of: fit}}\n")
    data = series()
    (row,) = validate(program, dataset(data, test=[40]), spec.checks, START).rows
    error, factor, _ = scored(data)
    assert row.value == pytest.approx(float(np.mean(error[factor > 0.02] ** 2)), rel=1e-12)
    assert row.scored == 2 * np.sum(factor > 0.02)
    # that is no number of values, and the table says so
    assert row.rows == f"{row.scored} values, each by its factor"


def test_a_loss_that_scores_no_row_keeps_no_limit() -> None:
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: 0 * w}}}}\n'
    program, spec = compiled(f"{model}validate:\n  - {{of: fit, max: 1}}\n")
    report = validate(program, dataset(series(), test=[40]), spec.checks, START)
    assert np.isnan(report.rows[0].value)
    assert not report.passed


@pytest.mark.parametrize(("value", "said"), [(-0.5, "is -0.5"), (np.nan, "is missing")])
def test_a_factor_below_0_or_missing_names_file_and_row(value: float, said: str) -> None:
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: w}}}}\n'
    program, spec = compiled(f"{model}validate:\n  - {{of: fit}}\n")
    data = series()
    data["w"][25] = value
    text = rf"`rows` of the loss `fit` {said} in row 5 of \w+1.csv"
    with pytest.raises(SpecError, match=text):
        losses(model, "epochs: 1", dataset(data, train=[20, 20]), START)
    with pytest.raises(SpecError, match=text):
        validate(program, dataset(data, test=[20, 20]), spec.checks, START)


def test_rows_that_do_not_count_may_have_any_factor() -> None:
    model = f'{MODEL}losses: {{fit: {{expr: "mse(y, z)", rows: w}}}}\n'
    data = series()
    data["w"][[2, 39]] = np.nan
    losses(model, "skip_rows: 3, engine: torch", dataset(data, train=[40]), START)
