"""Least squares with bounds: minima are reached, values on bounds exact, no false convergence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.bounded_fits.fits import by_msnn, by_scipy, is_wrongly_converged, without_bounds
from benchmarks.bounded_fits.problems import Problem, problems
from msnn.data.dataset import FloatArray
from msnn.training.engines.second_order.damped_steps import StepBox, box_step
from msnn.training.records.progress import Silent, StageEnd
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingResult
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

SOME = (
    "BoxBOD", "Eckerle4", "MGH09", "Misra1a", "Rat42", "michaelis_menten", "stribeck", "saturation",
    "antoine", "decay_and_offset",
)  # fmt: skip
"""Problems of `benchmarks/bounded_fits` that take milliseconds."""


@cache
def some_problems() -> list[Problem]:
    return [one for one in problems() if one.name.partition(",")[0] in SOME]


def test_as_many_minima_are_reached_as_by_scipy_and_none_is_claimed_wrongly() -> None:
    """A part of the benchmark: 100 pairs of problem and initial point, half of them with the
    minimum on a bound. The share may be a point below that of scipy's `trf`."""
    ours, theirs, wrong, off = 0, 0, [], []
    for problem in some_problems():
        fits = [by_msnn(problem, point) for point in problem.points]
        others = [by_scipy(problem, point) for point in problem.points]
        least = min(fit.loss for fit in (*fits, *others))
        ours += sum(fit.reached(least) for fit in fits)
        theirs += sum(fit.reached(least) for fit in others)
        wrong += [problem.name for fit in fits if is_wrongly_converged(problem, fit, least)]
        if problem.on_bound:
            on = [np.any((fit.x == problem.low) | (fit.x == problem.high)) for fit in fits]
            off += [problem.name for at in on if not at]
        for fit in fits:
            assert np.all((problem.low <= fit.x) & (fit.x <= problem.high))
    pairs = 5 * len(some_problems())
    assert pairs == 100
    assert ours >= theirs - 0.01 * pairs
    assert len(wrong) <= 0.01 * pairs, wrong
    # a cut minimum may have moved inside along a valley: most are on the bound
    assert len(off) <= 0.05 * pairs, off


def test_without_bounds_as_many_minima_are_reached_as_by_minpack() -> None:
    free = [without_bounds(one) for one in some_problems() if not one.on_bound]
    ours, theirs = 0, 0
    for problem in free:
        points = problem.points[:-1]  # the last one begins on a bound
        fits = [by_msnn(problem, point) for point in points]
        others = [by_scipy(problem, point, "lm") for point in points]
        least = min(fit.loss for fit in (*fits, *others))
        ours += sum(fit.reached(least) for fit in fits)
        theirs += sum(fit.reached(least) for fit in others)
    assert ours >= theirs


@pytest.mark.parametrize(
    ("name", "place"),
    [
        # a first step to a rate of 107, at which exp(−107 x) is nothing: nothing leads back
        ("BoxBOD", 0),
        ("BoxBOD", 3),
        # the curvature in b3 is 10²¹ times as large at the initial point as at the minimum
        ("Nelson", 3),
    ],
)
def test_a_parameter_does_not_stay_where_one_long_step_has_taken_it(name: str, place: int) -> None:
    """MINPACK reaches these minima; a stage ended in "no step lowers the total" there."""
    problem = without_bounds(next(one for one in problems() if one.name == name))
    fit = by_msnn(problem, problem.points[place])
    assert fit.reached(problem.loss(problem.known))
    assert fit.ended == "converged"


def test_a_step_within_a_box_is_the_least_of_its_quadratic() -> None:
    """By the conditions of Karush, Kuhn and Tucker, for 200 random quadratics and boxes."""
    random = np.random.default_rng(8)
    for _ in range(200):
        n = int(random.integers(1, 9))
        factor = random.normal(size=(n + 2, n))
        curvature = factor.T @ factor + 1e-9 * np.eye(n)
        slope = random.normal(size=n)
        low, high = -random.exponential(size=n), random.exponential(size=n)
        low[random.uniform(size=n) < 0.3] = -np.inf
        high[random.uniform(size=n) < 0.3] = np.inf
        low[random.uniform(size=n) < 0.2] = 0.0
        step = box_step(
            curvature, slope, StepBox(low=low, high=high, share=np.ones((2, n)), added=np.zeros(n))
        )
        gradient = slope + curvature @ step
        small = 1e-9 * (1.0 + np.abs(slope).max())
        assert np.all((low <= step) & (step <= high))
        assert np.all(gradient[step > low] <= small)
        assert np.all(gradient[step < high] >= -small)


ROD = """
msnn: 1
name: rod
sample_time: 1 s
dims: {node: 8, gap: 7}
inputs: {heat: {between: hold}, amb: {}}
targets: {T: {dims: node}}
parameters:
  a: {init: 0.05, min: 0.001, max: 0.2}
  h: {init: 0.01, min: 0, max: 0.3}
  b: {init: 0.5, min: 0.01, max: 5}
  D: {init: "where(abs(j-i) < 0.5, -1, where(abs(j-i-1) < 0.5, 1, 0))", dims: [gap, node],
      learn: false}
  first: {init: "where(i < 0.5, 1, 0)", dims: node, learn: false}
  last: {init: "where(i > 6.5, 1, 0)", dims: node, learn: false}
constants: {s: 1 s}
states:
  x: {dims: node, init: T.meas,
      der: "(-a * sum(D * (D @ x), over=gap) + b * first * heat - h * last * (x - amb)) / s"}
outputs: {T_hat: {expr: x, predicts: "T[t]"}}
train: [{epochs: 60, rollout: record, optimizer: OPTIMIZER}]
"""
"""A heated rod by the method of lines: conduction a, loss to the room h, heating b."""
TRUE = {"a": 0.12, "h": 0.06, "b": 0.8}


@cache
def rod_data() -> dict[str, FloatArray]:
    """The temperatures of the true rod, with 0.05 K of noise."""
    random = np.random.default_rng(7)
    rows, nodes, room = 200, 8, 20.0
    heat = np.repeat(random.uniform(0, 10, rows // 20), 20)
    gaps = np.diff(np.eye(nodes), axis=0)

    def slope(x: FloatArray, u: float) -> FloatArray:
        d = -TRUE["a"] * gaps.T @ gaps @ x
        d[0] += TRUE["b"] * u
        d[-1] -= TRUE["h"] * (x[-1] - room)
        return d

    x, log = np.full(nodes, room), []
    for u in heat:
        log.append(x)
        for _ in range(4):
            k1 = slope(x, u)
            k2 = slope(x + 0.125 * k1, u)
            k3 = slope(x + 0.125 * k2, u)
            x = x + 0.25 / 6 * (k1 + 2 * k2 + 2 * k3 + slope(x + 0.25 * k3, u))
    found = np.array(log) + 0.05 * random.standard_normal((rows, nodes))
    return {"heat": heat, "amb": np.full(rows, room), "T": found}


class Ends(Silent):
    """Keeps how stages end."""

    def __init__(self) -> None:
        self.reasons: list[str] = []

    def stage_ended(self, event: StageEnd) -> None:
        self.reasons.append(event.reason)


def train_rod(
    changes: dict[str, float], optimizer: str, ends: Silent | None = None
) -> TrainingResult:
    require_tool("gcc", install="apt install gcc")
    program, spec = compiled(ROD.replace("OPTIMIZER", optimizer))
    first = {
        p.name: np.array(p.initial).reshape([a.size for a in p.axes]) for p in program.parameters
    }
    first |= {name: np.array(value) for name, value in changes.items()}
    options = TrainingOptions(runs=None)
    return train(program, dataset(rod_data(), train=[200]), spec.train, options, ends, first)


@pytest.mark.parametrize("h", [0.0, 2e-12, 0.01, 0.05, 0.2, 0.3])
def test_a_bound_is_left_where_the_derivative_points_inward(h: float) -> None:
    """From 0.01 a first step of 22 in the logit of h once ended at 2e-12, called converged."""
    ends = Ends()
    result = train_rod({"h": h}, "levenberg_marquardt", ends)
    for name, value in TRUE.items():
        assert result.weights[name] == pytest.approx(value, rel=0.02)
    assert ends.reasons == ["converged"]


LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: INIT, BOUNDS}, b: 0}
outputs: {z: {expr: a * u + b}}
losses: {fit: 'mse(z, y)'}
train: [{epochs: 30, engine: ENGINE, optimizer: levenberg_marquardt}]
"""


@pytest.fixture(params=["native", "torch"])
def engine(request: pytest.FixtureRequest) -> str:
    if request.param == "native":
        require_tool("gcc", install="apt install gcc")
    return request.param


@pytest.mark.parametrize(
    ("init", "bounds", "wanted"),
    [
        ("0", "min: 0", 2.0),
        ("0", "min: 0, max: 1000", 2.0),
        ("5", "max: 5", 2.0),
        ("5", "min: 1, max: 5", 2.0),
        ("2.5", "min: 2.1", 2.1),
        ("1.5", "max: 1.7", 1.7),
        ("0.3", "min: 0.1, max: 0.7", 0.7),
        ("0.7", "min: 0.1, max: 0.7", 0.7),
        ("0.1", "min: 0.1, max: 0.7", 0.7),
        ("1e-7", "min: 0", 2.0),
    ],
)
def test_an_initial_value_on_a_bound_is_learned_from_and_bounds_are_exact(
    engine: str, init: str, bounds: str, wanted: float
) -> None:
    text = LINE.replace("INIT", init).replace("BOUNDS", bounds).replace("ENGINE", engine)
    program, spec = compiled(text)
    u = np.linspace(-1, 2, 40)
    data = dataset({"u": u, "y": 2.0 * u + 0.5}, train=[40])
    result = train(program, data, spec.train, TrainingOptions(runs=None))
    if wanted == 2.0:
        assert result.weights["a"] == pytest.approx(2.0, rel=1e-9)
    else:
        assert float(result.weights["a"]) == wanted
        # b is what least squares has beside this a
        assert result.weights["b"] == pytest.approx(0.5 + (2.0 - wanted) * u.mean(), rel=1e-9)
    assert not [d for d in result.warnings if d.code == "W0902"]


def test_a_prior_and_a_bound_hold_together() -> None:
    """The prior of a bounded value is the square of one more residual: exact between bounds."""
    u = np.linspace(-1, 2, 40)
    noise = np.random.default_rng(2).normal(0, 0.5, 40)
    series = {"u": u, "y": 2.0 * u + 0.5 + noise}
    found: list[float] = []
    for bounds in ("min: -9, max: 9", "prior: {mean: 1, std: 0.1}", "min: 0, max: 1.3"):
        prior = "" if "prior" in bounds else ", prior: {mean: 1, std: 0.1}"
        text = LINE.replace("INIT", "1.1").replace("BOUNDS", bounds + prior)
        program, spec = compiled(text.replace("ENGINE", "torch"))
        result = train(program, dataset(series, train=[40]), spec.train, TrainingOptions(runs=None))
        found.append(float(result.weights["a"]))
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    assert found[1] > 1.31
    assert found[2] == 1.3
