"""Standard errors beside outliers: sandwiches by hand, bootstraps, what has no errors."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.reports.training_summary import errors_note
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.parameters_record import parameters_record
from msnn.training.records.learned.standard_errors import StandardErrors, standard_errors
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingResult
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1, s: 1, w: 1}
parameters: {a: 1, b: 0.5}
outputs: {z: {expr: a * u + b}, twice: {expr: 2 * a * u}}
losses: LOSSES
train: [{engine: ENGINE, optimizer: {levenberg_marquardt: {tolerance: 1e-14}}}]
"""
ROWS = 300


def series(outliers: float = 0.1, rows: int = ROWS, seed: int = 7) -> dict[str, FloatArray]:
    """A line with noise of 0.02 and outliers of 5, a second output, factors, missing values."""
    random = np.random.default_rng(seed)
    u = random.uniform(-2, 3, rows)
    y = 0.7 * u + 2 + random.normal(0, 0.02, rows)
    bad = random.random(rows) < outliers
    y[bad] += random.normal(3, 5, bad.sum())
    y[5] = np.nan
    s = 1.4 * u + random.normal(0, 0.3, rows)
    return {"u": u, "y": y, "s": s, "w": random.choice([0.0, 0.5, 2.0], rows)}


def program_of(losses: str, engine: str = "torch") -> tuple[Program, str]:
    text = LINE.replace("LOSSES", losses).replace("ENGINE", engine)
    return compiled(text)[0], text


def errors_at(
    data: dict[str, FloatArray], losses: str, estimate: FloatArray, engine: str = "torch"
) -> StandardErrors:
    program, text = program_of(losses, engine)
    findings = Findings()
    if "mae" in losses or "exp" in losses:
        text = text.replace("levenberg_marquardt: {tolerance: 1e-14}", "adam: {lr: 0.1}")
    program, spec = compiled(text)
    (plan,) = plan_stages(program, spec.train, findings)
    findings.raise_errors()
    weights = {"a": np.array(estimate[0]), "b": np.array(estimate[1])}
    return standard_errors(plan, dataset(data, train=[len(data["u"])]), weights)


def fitted(
    columns: FloatArray,
    y: FloatArray,
    factors: FloatArray,
    deltas: FloatArray,
    settled: float = 1e-13,
) -> FloatArray:
    """The minimum of Σ factor · huber(columns · θ − y), by reweighted least squares."""
    root = np.sqrt(factors)
    found = np.linalg.lstsq(columns * root[:, None], y * root)[0]
    for _ in range(2000):
        error = columns @ found - y
        root = np.sqrt(factors * np.minimum(1, deltas / np.maximum(np.abs(error), 1e-300)))
        better = np.linalg.lstsq(columns * root[:, None], y * root)[0]
        if np.max(np.abs(better - found)) < settled:
            break
        found = better
    return np.asarray(found, float)


def by_hand(
    columns: FloatArray, y: FloatArray, factors: FloatArray, delta: float
) -> tuple[FloatArray, FloatArray]:
    """The estimate and H⁻¹ S H⁻¹ · n/(n − p) with H = Σ w ψ' jjᵀ, S = Σ w² ψ² jjᵀ."""
    estimate = fitted(columns, y, factors, np.full(len(y), delta))
    error = columns @ estimate - y
    inside = factors * (np.abs(error) <= delta)
    inverse = np.linalg.inv(columns.T @ (columns * inside[:, None]))
    gradient = columns * (factors * np.clip(error, -delta, delta))[:, None]
    count = np.count_nonzero(factors)
    covariance = inverse @ (gradient.T @ gradient) @ inverse * count / (count - 2)
    return estimate, np.sqrt(np.diagonal(np.asarray(covariance, float)))


def columns_of(data: dict[str, FloatArray]) -> FloatArray:
    return np.stack([data["u"], np.ones_like(data["u"])], axis=1)


@pytest.mark.parametrize("engine", ["torch", "native"])
@pytest.mark.parametrize("delta", [0.03, 0.5])
@pytest.mark.parametrize("rows", ["1", "w"])
def test_the_errors_of_huber_are_those_of_its_sandwich(
    engine: str, delta: float, rows: str
) -> None:
    if engine == "native":
        require_tool("gcc", install="apt install gcc")
    data = series()
    known = ~np.isnan(data["y"])
    factors = np.ones(ROWS) if rows == "1" else data["w"]
    estimate, expected = by_hand(columns_of(data)[known], data["y"][known], factors[known], delta)
    entry = f"expr: 'huber(z, y, delta={delta})'" + ("" if rows == "1" else ", rows: w")
    found = errors_at(data, f"{{fit: {{{entry}, weight: 30}}}}", estimate, engine)
    # reweighting stops where a step changes the last digits
    assert found.errors["a"] == pytest.approx(expected[0], rel=1e-6)
    assert found.errors["b"] == pytest.approx(expected[1], rel=1e-6)
    assert found.residuals == np.count_nonzero(factors[known])
    assert found.unidentified == ()


def test_the_errors_of_huber_are_those_of_a_bootstrap() -> None:
    """With outliers the errors of squares are 12 times those of huber."""
    data = series()
    known = ~np.isnan(data["y"])
    columns, y = columns_of(data)[known], data["y"][known]
    ones, deltas = np.ones(len(y)), np.full(len(y), 0.03)
    random = np.random.default_rng(3)
    drawn = [random.integers(0, len(y), len(y)) for _ in range(300)]
    spread = np.std([fitted(columns[i], y[i], ones, deltas) for i in drawn], axis=0)
    found = errors_at(data, "{fit: 'huber(z, y, delta=0.03)'}", fitted(columns, y, ones, deltas))
    # 300 draws know a standard deviation to 1 / √600 = 4 %, and the two estimate it apart
    assert found.errors["a"] == pytest.approx(spread[0], rel=0.15)
    assert found.errors["b"] == pytest.approx(spread[1], rel=0.15)
    squares = errors_at(data, "{fit: 'mse(z, y)'}", fitted(columns, y, ones, 1e9 * deltas))
    assert squares.errors["a"] > 10 * found.errors["a"]


def test_noise_that_differs_from_row_to_row_is_seen_beside_huber() -> None:
    """White 1980: large errors where u is large count there."""
    random = np.random.default_rng(2)
    u = random.uniform(-1, 1, 4000)
    y = 0.7 * u + 2 + random.normal(0, 1, 4000) * np.abs(u)
    data = {**series(rows=4000), "u": u, "y": y}
    estimate, _ = by_hand(columns_of(data), y, np.ones(4000), 100.0)
    found = errors_at(data, "{fit: 'huber(z, y, delta=100)'}", estimate)
    # E u⁴ / (E u²)² = 9/5 of the variance 1/3, and E u⁴ = 1/5: √(1/5 / (1/9) / n)
    assert found.errors["a"] == pytest.approx(np.sqrt(9 / 5 / 4000), rel=0.05)


def of_both(data: dict[str, FloatArray], other: str, weight: float) -> FloatArray:
    """The minimum of mean huber(a u + b − y) + weight · other(2 a u − s), by rows in one system."""
    u, count = data["u"], len(data["u"])
    columns = np.concatenate([columns_of(data), np.stack([2 * u, np.zeros(count)], axis=1)])
    both = np.concatenate([data["y"], data["s"]])
    deltas = np.repeat([0.03, 0.2 if other == "huber" else 1e9], count)
    factor = weight if other == "huber" else 2 * weight
    root, found = 1.0, np.zeros(2)
    for _ in range(20 if other == "rmse" else 1):
        factors = np.repeat([1.0, factor / (2 * root if other == "rmse" else 1.0)], count)
        # what is asked of it is a spread, to 20 %
        found = fitted(columns, both, factors, deltas, settled=1e-7)
        root = float(np.sqrt(np.mean((2 * u * found[0] - data["s"]) ** 2)))
    return found


@pytest.mark.parametrize("weight", [0.0005, 0.01, 1.0])
@pytest.mark.parametrize("other", ["mse", "rmse", "huber"])
def test_several_losses_spread_as_often_repeated_trainings_do(other: str, weight: float) -> None:
    """A slope that a robust loss sees, and another one, whatever their weights are."""
    delta = ", delta=0.2" if other == "huber" else ""
    losses = (
        "{one: 'huber(z, y, delta=0.03)', "
        f"two: {{expr: '{other}(twice, s{delta})', weight: {weight}}}}}"
    )
    found: list[FloatArray] = []
    said: list[FloatArray] = []
    for seed in range(150):
        data = series(seed=seed, rows=120)
        data["y"][5] = 2 + 0.7 * data["u"][5]
        found.append(of_both(data, other, weight))
        if seed % 10 == 0:
            errors = errors_at(data, losses, found[-1])
            said.append(np.array([errors.errors["a"], errors.errors["b"]]))
    spread = np.std(found, axis=0)
    # 150 draws know a standard deviation to 1 / √300 = 6 %, 15 estimates their mean about as well
    np.testing.assert_allclose(np.mean(said, axis=0), spread, rtol=0.2)


@pytest.mark.parametrize(
    ("losses", "reason"),
    [
        ("{fit: 'mae(z, y)'}", "those of `fit`, a mae, depend on the density of its noise at 0"),
        ("{fit: 'mse(z, y)', size: 'mae(twice, s)'}", "those of `size`, a mae, depend on"),
        ("{fit: 'mse(z, y)', cost: 'exp(a)'}", "`cost` is no sum of squares"),
        ("{fit: 'mse(z, y) + 0.1 * mae(z, y)'}", "those of `fit.mae`, a mae"),
        ("{fit: 'huber(z, y, delta=1e-4)'}", "residuals of `fit` are within its delta, too few"),
    ],
)
def test_without_a_known_curvature_there_are_none(losses: str, reason: str) -> None:
    """The parameters minimise the sum: squares alone do not say how sure they are."""
    data = series()
    found = errors_at(data, losses, np.array([0.7, 2.0]))
    assert found.errors == {}
    program, _ = program_of("{fit: 'mse(z, y)'}")
    weights = {"a": np.array(0.7), "b": np.array(2.0)}
    assert reason in str(errors_note(parameters_record(program, weights, found)))


@pytest.mark.parametrize(
    "losses",
    [
        "{fit: 'mse(z, y)', idle: {expr: 'mae(z, y)', weight: 0}}",
        "{fit: 'mse(z, y)', of_data: 'mae(s, y)'}",
        "{fit: 'mse(z, y)', few: {expr: l1(a), weight: 1e-3}}",
    ],
)
def test_what_has_no_curvature_leaves_the_errors_as_they_are(losses: str) -> None:
    data = series(outliers=0.0)
    alone = errors_at(data, "{fit: 'mse(z, y)'}", np.array([0.7, 2.0]))
    found = errors_at(data, losses, np.array([0.7, 2.0]))
    assert found.reason is None
    assert found.errors == alone.errors


def test_a_number_that_only_outliers_see_has_no_error() -> None:
    """Clipped residuals have no curvature; that is another thing than to change nothing."""
    data = series(outliers=0.0)
    data["y"][:150] -= 0.7 * data["u"][:150]
    data["u"][:150] = 0.0
    data["y"][150:] += 50
    found = errors_at(data, "{fit: 'huber(z, y, delta=0.1)'}", np.array([0.7, 2.0]))
    assert found.reason == "residuals within delta do not determine the learned numbers"


DECAY = """
msnn: 1
name: decay
sample_time: 1 s
inputs: {u: 1}
targets: {y: 1}
parameters: {k: {init: 0.8}, b: {init: 1.5}X0}
states: {x: {next: k * x + b * u, init: START}}
outputs: {z: {expr: x, predicts: y}}
losses: {fit: 'huber(z, y, delta=0.03)'}
train: [{engine: ENGINE, epochs: 60, rollout: ROLLOUT, optimizer: OPTIMIZER}]
"""
FITTED = DECAY.replace("START", "{fit: {over: record, from: y}}").replace("X0", "")


def decaying(rows: int = 200) -> dict[str, FloatArray]:
    """x(t + 1) = 0.9 x + u from 1, with noise of 0.02 and outliers on one side."""
    random = np.random.default_rng(11)
    u, x = random.uniform(-1, 1, rows), np.ones(rows)
    for t in range(rows - 1):
        x[t + 1] = 0.9 * x[t] + u[t]
    y = x + random.normal(0, 0.02, rows)
    y[3::9] += 1.0
    return {"u": u, "y": y}


def trained_errors(text: str, data: dict[str, FloatArray]) -> tuple[TrainingResult, StandardErrors]:
    program, spec = compiled(text)
    (plan,) = plan_stages(program, spec.train, Findings())
    rows = dataset(data, train=[len(data["u"])])
    found = train(program, rows, spec.train, TrainingOptions(runs=None))
    return found, standard_errors(plan, rows, found.weights, found.stages[-1].starts)


@pytest.mark.parametrize("engine", ["torch", "native"])
@pytest.mark.parametrize("rollout", ["record", "{horizon: 100, stride: 100}"])
def test_errors_of_huber_beside_fitted_starts_are_those_of_starts_that_are_parameters(
    engine: str, rollout: str
) -> None:
    """The same minimum and the same sums, with the start of each rollout as one more number."""
    if engine == "native":
        require_tool("gcc", install="apt install gcc")
    data = decaying()
    lm = "{levenberg_marquardt: {tolerance: 1e-14}}"
    text = FITTED.replace("ENGINE", engine).replace("OPTIMIZER", lm)
    found, errors = trained_errors(text.replace("ROLLOUT", rollout), data)
    assert errors.reason is None
    assert found.starts is not None
    first = DECAY.replace("ENGINE", engine).replace("OPTIMIZER", lm)
    if rollout == "record":
        first = first.replace("X0", ", x0: {init: 0.5}").replace("START", "x0")
    else:
        data["second"] = (np.arange(200) >= 100).astype(float)
        first = first.replace("X0", ", x0: {init: 0.5}, x1: {init: 0.5}")
        first = first.replace("START", "x0 + second * (x1 - x0)")
        first = first.replace("{u: 1}", "{u: 1, second: 1}")
    other, expected = trained_errors(first.replace("ROLLOUT", rollout), data)
    for name in ("k", "b"):
        assert found.weights[name] == pytest.approx(other.weights[name], abs=1e-7)
        assert errors.errors[name] == pytest.approx(expected.errors[name], rel=1e-4)
    assert errors.noise["fit"] == pytest.approx(expected.noise["fit"], rel=1e-4)
    assert errors.residuals == expected.residuals == 200


def test_errors_of_huber_beside_fitted_starts_are_those_of_repeated_trainings() -> None:
    """Squares would say five times as much, for the outliers that huber leaves aside."""
    require_tool("gcc", install="apt install gcc")
    random = np.random.default_rng(12)
    text = FITTED.replace("ENGINE", "native").replace("OPTIMIZER", "levenberg_marquardt")
    text = text.replace("ROLLOUT", "record")
    estimates: list[float] = []
    said: list[float] = []
    for _ in range(30):
        data = decaying(120)
        data["y"] += random.normal(0, 0.03, 120)
        found, errors = trained_errors(text, data)
        estimates.append(float(found.weights["k"]))
        said.append(float(errors.errors["k"]))
    # 30 draws know a standard deviation to 1 / √60 = 13 %; noise of 0.02 is in all of them
    assert 0.6 < np.std(estimates) / (np.mean(said) * 0.03 / np.hypot(0.02, 0.03)) < 1.4


@pytest.mark.parametrize(
    ("optimizer", "over", "reason"),
    [
        ("adam", "5", "`fit` is huber, and its starts minimise squares; `levenberg_marquardt` "),
        ("lbfgs", "record", "`fit` is huber, and its starts minimise squares"),
        ("levenberg_marquardt", "5", None),
    ],
)
def test_starts_that_are_fitted_by_squares_leave_huber_without_errors(
    optimizer: str, over: str, reason: str | None
) -> None:
    text = FITTED.replace("ENGINE", "torch").replace("OPTIMIZER", optimizer)
    text = text.replace("ROLLOUT", "{horizon: 20, stride: 20}").replace(
        "over: record", f"over: {over}"
    )
    _, errors = trained_errors(text.replace("epochs: 60", "epochs: 5"), decaying(100))
    if reason is None:
        # unknowns of training, whatever `over` says
        assert errors.reason is None
    else:
        assert str(errors.reason).startswith(reason)
