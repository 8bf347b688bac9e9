"""Standard errors where the first rows of each run decide its start, and later ones the rest."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.standard_errors import StandardErrors, standard_errors
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset
from tests.training.oscillator import FITTED, TRUE, best_start, positions, records

OVER, ROWS = 12, 40
MODEL = (
    FITTED.replace("over: 2 s", f"over: {OVER}")
    .replace("over: 40", f"over: {OVER}")
    # near the minimum, where errors are told: ways to it from afar have tests of their own
    .replace("init: 6,", "init: 5,")
    .replace("init: 0.3,", "init: 0.2,")
)


def learned(
    series: dict[str, FloatArray], stage: str, engine: str, rows: int
) -> tuple[FloatArray, StandardErrors]:
    """k and d, and their errors."""
    # a kernel gets to the minimum sooner than torch, which has to take a step there
    stages = f"  - {{name: there, epochs: 40, {stage}, engine: native}}\n"
    stages += f"  - {{name: stays, epochs: 1, {stage}, engine: {engine}}}\n"
    program, spec = compiled(f"{MODEL}train:\n{stages}")
    data = dataset(series, train=[rows] * (len(series["q"]) // rows))
    found = train(program, data, spec.train, TrainingOptions(runs=None))
    assert found.stages[-1].epochs > 0
    *_, plan = plan_stages(program, spec.train, Findings())
    assert not plan.estimates_starts
    return np.array([found.weights[n] for n in TRUE]), standard_errors(plan, data, found.weights)


def residuals(numbers: FloatArray, u: FloatArray, q: FloatArray, begin: FloatArray) -> FloatArray:
    """Of one run, after the rows that decide its start."""
    return (positions(float(numbers[0]), float(numbers[1]), begin, u) - q)[OVER:]


def slope_in_numbers(numbers: FloatArray, u: FloatArray, q: FloatArray) -> FloatArray:
    """Jᵀr of one run, its start held where its first rows put it."""
    begin = best_start(float(numbers[0]), float(numbers[1]), u[:OVER], q[:OVER])
    steps = 1e-5 * np.eye(2)
    ends = [[residuals(numbers + s * h, u, q, begin) for s in (1, -1)] for h in steps]
    slopes = np.array([(high - low) / 2e-5 for high, low in ends])
    return np.asarray(slopes @ residuals(numbers, u, q, begin), np.float64)


def influence(
    numbers: FloatArray, u: FloatArray, q: FloatArray, runs: list[slice], step: float
) -> tuple[FloatArray, FloatArray]:
    """By differences: how the estimate, and then what is left, follow every measured value."""

    def slopes(at: FloatArray, measured: FloatArray, some: list[slice]) -> FloatArray:
        return np.sum([slope_in_numbers(at, u[r], measured[r]) for r in some], axis=0)

    def left(at: FloatArray, measured: FloatArray) -> FloatArray:
        begins = [
            best_start(float(at[0]), float(at[1]), u[r][:OVER], measured[r][:OVER]) for r in runs
        ]
        found = [residuals(at, u[r], measured[r], x) for r, x in zip(runs, begins, strict=True)]
        return np.concatenate(found)

    ways = 1e-5 * np.eye(2)
    curvature = np.stack(
        [(slopes(numbers + h, q, runs) - slopes(numbers - h, q, runs)) / 2e-5 for h in ways],
        axis=1,
    )
    of_numbers, of_residuals = np.zeros((2, len(q))), np.zeros((len(left(numbers, q)), len(q)))
    for row in range(len(q)):
        high, low = q.copy(), q.copy()
        high[row] += step
        low[row] -= step
        some = [r for r in runs if r.start <= row < r.stop]
        slope = (slopes(numbers, high, some) - slopes(numbers, low, some)) / (2 * step)
        of_numbers[:, row] = -np.linalg.solve(curvature, slope)
        of_residuals[:, row] = (left(numbers, high) - left(numbers, low)) / (2 * step)
    follow = [(left(numbers + h, q) - left(numbers - h, q)) / 2e-5 for h in ways]
    return of_numbers, of_residuals + np.array(follow).T @ of_numbers


@pytest.mark.parametrize("engine", ["native", "torch"])
@pytest.mark.parametrize("stride", [ROWS, 8])
def test_errors_count_the_noise_that_starts_carry(stride: int, engine: str) -> None:
    """The estimate is moved by every measured value in turn; noise so small that it is linear."""
    require_tool("gcc", install="apt install gcc")
    records_of, rows = (2, ROWS) if stride == ROWS else (1, 80)
    series = records(records_of, rows, seed=6, noise=1e-5)
    rollout = f"rollout: {{horizon: {ROWS}, stride: {stride}}}"
    stage = f"{rollout}, dtype: float64, optimizer: {{lbfgs: {{iterations: 20}}}}"
    numbers, found = learned(series, stage, engine, rows)
    u, q = series["u"], series["q"]
    begins = range(0, len(q) - ROWS + 1, stride)
    runs = [slice(begin, begin + ROWS) for begin in begins]
    of_numbers, of_residuals = influence(numbers, u, q, runs, 1e-4)
    starts = [
        best_start(float(numbers[0]), float(numbers[1]), u[r][:OVER], q[r][:OVER]) for r in runs
    ]
    left = np.concatenate(
        [residuals(numbers, u[r], q[r], x) for r, x in zip(runs, starts, strict=True)]
    )
    sigma = np.linalg.norm(left) / np.linalg.norm(of_residuals)
    expected = sigma * np.linalg.norm(of_numbers, axis=1)
    # of second derivatives times residuals of 1e-5, which Gauss-Newton leaves out, and differences;
    # where runs overlap, of the two numbers that residuals pay for as if each were a value's own
    tolerance = 1e-3 if stride == ROWS else 2 / len(q)
    assert found.noise["y"] == pytest.approx(sigma, rel=tolerance)
    assert [found.errors[name] for name in TRUE] == pytest.approx(expected, rel=tolerance)
