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
MODEL = FITTED.replace("over: 2 s", f"over: {OVER}").replace("over: 40", f"over: {OVER}")
HELD = f"rollout: {{horizon: {ROWS}, stride: {ROWS}}}"


def learned(
    series: dict[str, FloatArray], stage: str, model: str = MODEL
) -> tuple[FloatArray, StandardErrors]:
    """k and d, and their errors."""
    program, spec = compiled(f"{model}train:\n  - {{epochs: 60, {stage}}}\n")
    data = dataset(series, train=[ROWS] * (len(series["q"]) // ROWS))
    found = train(program, data, spec.train, TrainingOptions(runs=None))
    (plan,) = plan_stages(program, spec.train, Findings())
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
    return slopes @ residuals(numbers, u, q, begin)


def influence(
    numbers: FloatArray, u: FloatArray, q: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """By differences: how the estimate, and then what is left, follow every measured value."""
    runs = range(len(u))

    def total(at: FloatArray) -> FloatArray:
        return np.sum([slope_in_numbers(at, u[r], q[r]) for r in runs], axis=0)

    def left(at: FloatArray, run: int, measured: FloatArray) -> FloatArray:
        begin = best_start(float(at[0]), float(at[1]), u[run][:OVER], measured[:OVER])
        return residuals(at, u[run], measured, begin)

    curvature = np.stack(
        [(total(numbers + h) - total(numbers - h)) / 2e-5 for h in 1e-5 * np.eye(2)], axis=1
    )
    of_numbers: list[FloatArray] = []
    of_residuals = np.zeros((len(u) * (ROWS - OVER), q.size))
    for run in runs:
        for row in range(ROWS):
            high, low = q[run].copy(), q[run].copy()
            high[row] += step
            low[row] -= step
            slope = slope_in_numbers(numbers, u[run], high)
            slope = (slope - slope_in_numbers(numbers, u[run], low)) / (2 * step)
            of_numbers.append(-np.linalg.solve(curvature, slope))
            inside = slice(run * (ROWS - OVER), (run + 1) * (ROWS - OVER))
            moved = left(numbers, run, high) - left(numbers, run, low)
            of_residuals[inside, run * ROWS + row] = moved / (2 * step)
    follow = np.array(
        [
            np.concatenate([(left(numbers + h, r, q[r]) - left(numbers - h, r, q[r])) / 2e-5
                            for r in runs])
            for h in 1e-5 * np.eye(2)
        ]
    )  # fmt: skip
    return np.array(of_numbers).T, of_residuals + follow.T @ np.array(of_numbers).T


@pytest.mark.parametrize(
    "stage",
    [
        f"{HELD}, optimizer: {{levenberg_marquardt: {{tolerance: 1e-14}}}}",
        f"{HELD}, optimizer: {{levenberg_marquardt: {{tolerance: 1e-14}}}}, engine: torch",
    ],
)
def test_errors_count_the_noise_that_starts_carry(stage: str) -> None:
    """The estimate is moved by every measured value in turn; noise so small that it is linear."""
    require_tool("gcc", install="apt install gcc")
    noise = 1e-5
    series = records(2, ROWS, seed=6, noise=noise)
    numbers, found = learned(series, stage)
    u, q = series["u"].reshape(-1, ROWS), series["q"].reshape(-1, ROWS)
    of_numbers, of_residuals = influence(numbers, u, q, 1e-4)
    begins = [
        best_start(*map(float, numbers), a[:OVER], b[:OVER]) for a, b in zip(u, q, strict=True)
    ]
    left = np.concatenate(
        [residuals(numbers, a, b, x) for a, b, x in zip(u, q, begins, strict=True)]
    )
    sigma = np.linalg.norm(left) / np.linalg.norm(of_residuals)
    expected = sigma * np.linalg.norm(of_numbers, axis=1)
    # of second derivatives times residuals of 1e-5, which Gauss-Newton leaves out, and differences
    assert found.noise["y"] == pytest.approx(sigma, rel=1e-3)
    assert [found.errors[name] for name in TRUE] == pytest.approx(expected, rel=1e-3)
