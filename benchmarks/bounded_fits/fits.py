"""Runs a problem through the steps of msnn's `levenberg_marquardt`, and through scipy's methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import least_squares

from backends.gauss_newton_products import Products
from benchmarks.bounded_fits.problems import Array, Problem
from compiler.elaboration.compile import compile_spec
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import NonFiniteLossError
from msnn.training.engines.second_order.levenberg_marquardt import LevenbergMarquardtEngine
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.reading.reader import read_spec

MOST_JACOBIANS = 400
CLOSE = 1.01
"""Times the least loss: a fit below has reached the minimum."""
EXACT = 1e-20
"""Mean squares that are rounding: those of data without noise."""
STEEP = 1e-4
"""Cosine of residuals and a derivative above which a point is no minimum."""


@dataclass(frozen=True)
class Fit:
    """The result of a method: its final point, loss and number of Jacobians."""

    x: Array
    loss: float
    jacobians: int
    losses: int
    ended: str

    def reached(self, least: float) -> bool:
        """True if the loss is within 1 % of the least that is known."""
        return self.loss <= CLOSE * least + EXACT


class _Squares:
    """The residuals and Jacobian of a problem in numpy, in the form that the engine needs."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.jacobians = self.losses = 0

    def check(self, runs: Runs, weights: Mapping[str, Array]) -> None:
        """Does nothing: numpy needs no check."""

    def write(self, series: Mapping[str, Array], *, watched: bool) -> None:
        """Does nothing: the problem has no initial states."""

    def products(self, runs: Runs, weights: Mapping[str, Array]) -> dict[str, Products]:
        """JᵀJ and Jᵀr of the problem at these parameters."""
        self.jacobians += 1
        x = _vector(weights)
        r, j = self._problem.residual(x), self._problem.jacobian(x)
        with np.errstate(all="ignore"):
            cost = float(r @ r)
            return {"fit": Products(j.T @ j, j.T @ r, cost, cost, float(len(r)))}

    def train_costs(self, runs: Runs, weights: Mapping[str, Array]) -> dict[str, LossSum]:
        """rᵀr of the problem at these parameters."""
        self.losses += 1
        r = self._problem.residual(_vector(weights))
        with np.errstate(all="ignore"):
            return {"fit": LossSum(float(r @ r), float(len(r)))}

    watched_costs = train_costs


def _vector(weights: Mapping[str, Array]) -> Array:
    return np.array([float(weights[f"b{i + 1}"]) for i in range(len(weights))])


@cache
def _plan(low: tuple[float, ...], high: tuple[float, ...]) -> StagePlan:
    """A stage that learns parameters b1, b2, … within these bounds."""
    names = [f"b{i + 1}" for i in range(len(low))]
    entries: list[str] = []
    for name, least, most in zip(names, low, high, strict=True):
        ends = ", ".join(
            f"{key}: {end!r}" for key, end in (("min", least), ("max", most)) if np.isfinite(end)
        )
        first = least if np.isfinite(least) else 0.0
        entries.append(f"{name}: {{init: {first!r}{', ' * bool(ends)}{ends}}}")
    text = (
        f"msnn: 1\nname: fit\ninputs: {{u: 1}}\ntargets: {{y: 1}}\n"
        f"parameters: {{{', '.join(entries)}}}\n"
        f"outputs: {{z: {{expr: ({' + '.join(names)}) * u}}}}\nlosses: {{fit: 'mse(z, y)'}}\n"
        f"train: [{{epochs: {MOST_JACOBIANS}, optimizer: levenberg_marquardt}}]\n"
    )
    spec = read_spec("fit.msnn.yaml", text).spec
    program = compile_spec(spec, spec_hash="0" * 64).program
    (plan,) = plan_stages(program, spec.train, Findings())
    return plan


def by_msnn(problem: Problem, x: Array, *, most: int = MOST_JACOBIANS) -> Fit:
    """Fits a problem from a point by `levenberg_marquardt`."""
    plan = _plan(tuple(map(float, problem.low)), tuple(map(float, problem.high)))
    squares = _Squares(problem)
    given = {f"b{i + 1}": np.array(value) for i, value in enumerate(x)}
    engine = LevenbergMarquardtEngine(
        plan,
        {"u": np.zeros(2)},
        given,
        None,
        None,
        lambda *_: squares,  # pyright: ignore[reportArgumentType]
    )
    runs = Runs(np.arange(1), np.ones(1, np.int64), 0, 0)
    try:
        while engine.finished is None and squares.jacobians < most:
            engine.train_batches(runs, 1)
    except NonFiniteLossError as error:  # no derivative at the point itself
        return Fit(x, problem.loss(x), squares.jacobians, squares.losses, str(error))
    found = _vector(engine.weights())
    ended = engine.finished or "epochs"
    return Fit(found, problem.loss(found), squares.jacobians, squares.losses, ended)


def by_scipy(problem: Problem, x: Array, method: str = "trf", most: int = MOST_JACOBIANS) -> Fit:
    """Fits a problem from a point by `scipy.optimize.least_squares`; its method `lm` ignores
    bounds.
    """
    jacobians = 0

    def jacobian(at: Array) -> Array:
        nonlocal jacobians
        jacobians += 1
        return problem.jacobian(at)

    bounds = (-np.inf, np.inf) if method == "lm" else (problem.low, problem.high)
    try:
        with np.errstate(all="ignore"):
            found = least_squares(
                problem.residual,
                x,
                jacobian,
                bounds,
                method,
                x_scale="jac",
                ftol=1e-12,
                xtol=1e-12,
                gtol=1e-12,
                max_nfev=most,
            )
    except (ValueError, np.linalg.LinAlgError) as error:
        return Fit(x, problem.loss(x), jacobians, 0, str(error))
    x = np.asarray(found.x, float)
    return Fit(x, problem.loss(x), jacobians, int(found.nfev), str(found.status))


def without_bounds(problem: Problem) -> Problem:
    """The same problem without bounds."""
    free = np.full(len(problem.low), np.inf)
    return Problem(
        name=problem.name,
        model=problem.model,
        target=problem.target,
        low=-free,
        high=free,
        points=problem.points,
        known=problem.known,
    )


def is_wrongly_converged(problem: Problem, fit: Fit, least: float) -> bool:
    """True if a fit reports convergence although its loss can decrease further, as scipy's `trf`
    shows.
    """
    if fit.ended != "converged" or fit.reached(least) or steepness(problem, fit.x) <= STEEP:
        return False
    return by_scipy(problem, fit.x).loss < fit.loss / CLOSE


def steepness(problem: Problem, x: Array) -> float:
    """The largest |Jᵢᵀr|/(|Jᵢ||r|) of the parameters that may move downhill."""
    r, j = problem.residual(x), problem.jacobian(x)
    slope, size = j.T @ r, np.linalg.norm(j, axis=0) * np.linalg.norm(r)
    near = np.where(np.isfinite(problem.high - problem.low), problem.high - problem.low, 0.0)
    held = (x - problem.low <= 1e-9 * near) & (slope > 0)
    held |= (problem.high - x <= 1e-9 * near) & (slope < 0)
    held |= size == 0
    return float(np.max(np.where(held, 0.0, np.abs(slope) / np.where(held, 1.0, size))))
