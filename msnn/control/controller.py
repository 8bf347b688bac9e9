"""The predictive controller of a model: measures, solves, keeps its plan for the next sample."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from compiler.ir.program import Signal
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from compiler.optimal_control.horizon import Array, Given, by_name
from compiler.optimal_control.kkt import Judge, Residuals
from compiler.optimal_control.problem import ControlProblem
from msnn.control.control_range import ControlRange
from msnn.control.horizon_functions import HorizonFunctions
from msnn.control.interior_point import InteriorPoint, Outcome
from msnn.control.iterate import Iterate
from msnn.control.memory import Memory
from msnn.control.solution import Solution, Status

if TYPE_CHECKING:
    from backends.casadi_function.optimal_control import OptimalControlNlp

_FAR = 1e4
"""A cold start that leads beyond so many scales is no help."""


class Controller:
    """A predictive controller, `msnn.mpc(model)`; it remembers its plan from solve to solve."""

    def __init__(self, problem: ControlProblem) -> None:
        self.problem = problem
        self._functions = HorizonFunctions(problem)
        self._memory = Memory(problem, self._functions.interpreter)
        self._judge: Judge | None = None
        self._applied: Array | None = None
        self._last: Iterate | None = None
        self._is_good = False

    def reset(
        self,
        x: Mapping[str, ArrayLike] | None = None,
        control: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Forgets plan and memory; `x` are states and `control` what is applied, where known."""
        self._memory.forget()
        self._applied, self._last, self._is_good = None, None, False
        if control is not None:
            self._applied = _joined(self.problem.controls, control, "control")
        if x is not None:
            self._memory.measure(x)

    def solve(
        self,
        x: Mapping[str, ArrayLike] | None = None,
        *,
        references: Mapping[str, ArrayLike] | None = None,
        disturbances: Mapping[str, ArrayLike] | None = None,
    ) -> Solution:
        """The control at t and the plan behind it.

            found = controller.solve({"upper": 2.0, "lower": 3.0}, references={"level": 6.0})
            apply(found.control["pump"])

        `x` are measured states, and measured samples of signals that outputs predict; what is not
        given is as predicted from the sample before. References and disturbances are samples at t,
        or with a preview (N+1, *shape) and (N, *shape). Raises ValueError for names and shapes that
        the problem does not have.
        """
        problem, before = self.problem, self._memory.known
        self._memory.measure(x or {})
        coming = self._coming(problem.disturbances, disturbances or {}, problem.horizon)
        wanted = self._coming(problem.references, references or {}, problem.horizon + 1)
        now = {name: samples[0] for name, samples in coming.items()}
        self._memory.begin(now | by_sample(problem.controls, self._resting()))
        if not self._memory.is_complete:
            return self._kept(Status.NOT_INITIALISED)
        given = Given(self._memory.vector(), coming, wanted)
        if not _is_finite(given):
            self._memory.restore(before)
            return self._kept(Status.INPUT_NOT_FINITE)
        limits = self._functions.limits(given)
        if np.any(np.isnan(limits.low)) or np.any(np.isnan(limits.high)):
            return self._kept(Status.INPUT_NOT_FINITE)
        allowed = ControlRange(self._functions, limits, given.state)
        if not allowed.is_possible:
            found = self._kept(Status.INFEASIBLE, allowed)
        else:
            found = self._found(given, allowed)
        self._applied = _joined(problem.controls, found.control, "control")
        self._memory.advance(given, self._applied)
        return found

    def residuals(self, solution: Solution) -> Residuals:
        """The optimality conditions of a plan, judged apart from the solver.

        ValueError for a solution without a plan.
        """
        if solution.given is None or solution.plan is None or solution.multipliers is None:
            raise ValueError("the solution has no plan")
        self._judge = self._judge or Judge(self.problem)
        return self._judge.residuals(solution.given, solution.plan, solution.multipliers)

    def casadi(
        self, solver: Literal["ipopt", "fatrop"] = "ipopt", options: Mapping[str, Any] | None = None
    ) -> OptimalControlNlp:
        """The same problem for a solver of CasADi, to compare with; `options` are its own.

        nlp = controller.casadi("fatrop")
        print(nlp.solve(found.given, found.plan).cost, found.cost)
        """
        from backends.casadi_function.optimal_control import OptimalControlNlp

        return OptimalControlNlp(self.problem, solver, options)

    # ---- one solve

    def _found(self, given: Given, allowed: ControlRange) -> Solution:
        method = InteriorPoint(self._functions, given)
        stops = self.problem.mode == "converged"
        iterations, tolerance = self.problem.iterations, self.problem.tolerance
        solve = partial(method.solve, iterations=iterations, tolerance=tolerance, stops=stops)
        outcome: Outcome | None = None
        if self._last is not None and self._is_good:
            before = _shifted(self._last)
            controls = allowed.blocked(before.controls)
            outcome = solve(before.states, controls, before)
        if outcome is None or (stops and not outcome.residual <= self.problem.tolerance):
            states, controls = self._cold(given, allowed)
            again = solve(states, controls, None)
            if outcome is None or not outcome.residual <= again.residual:
                outcome = again
        return self._told(given, allowed, outcome)

    def _cold(self, given: Given, allowed: ControlRange) -> tuple[Array, Array]:
        """A plan to begin with: the last one clipped and rolled out, or what is applied now."""
        n, scale = self.problem.horizon, self._functions.scale_u
        controls = np.tile(self._resting() / scale, (n, 1))
        if self._last is not None:
            controls = _shifted(self._last).controls
        controls = allowed.nearest(np.where(np.isfinite(controls), controls, 0.0))
        states = self._functions.rollout(given, controls)
        start = given.state / self._functions.scale_x
        limit = _FAR * max(1.0, float(np.max(np.abs(start), initial=0.0)))
        if not np.all(np.abs(states) <= limit):
            states = np.tile(start, (n + 1, 1))
        return states, controls

    def _told(self, given: Given, allowed: ControlRange, outcome: Outcome) -> Solution:
        f, problem = self._functions, self.problem
        is_solved = outcome.residual <= problem.tolerance
        keeps = outcome.violation <= max(problem.tolerance, 1e-6)
        is_finite = np.isfinite(outcome.residual)
        self._last, self._is_good = outcome.iterate if is_finite else None, bool(is_solved)
        if not (is_finite and keeps):
            return self._kept(Status.INFEASIBLE, allowed, outcome)
        controls = allowed.nearest(outcome.iterate.controls)
        plan = f.plan(outcome.iterate.states, controls)
        penalties, excess = f.penalties(given, outcome.iterate.states, controls)
        return Solution(
            status=Status.SOLVED if is_solved else Status.CAPPED,
            control=by_sample(problem.controls, plan.controls[0]),
            controls=by_name(problem.controls, plan.controls),
            states=by_name(problem.states, plan.states),
            cost=f.values(given, outcome.iterate.states, controls).cost + penalties,
            residual=outcome.residual,
            violation=outcome.violation,
            excess=excess,
            iterations=outcome.iterations,
            given=given,
            plan=plan,
            multipliers=f.multipliers(outcome.iterate.multipliers),
        )

    def _kept(
        self, status: Status, allowed: ControlRange | None = None, outcome: Outcome | None = None
    ) -> Solution:
        """The last control, within its own limits where these are known."""
        control = self._resting()
        if allowed is not None:
            control = allowed.first(control / self._functions.scale_u) * self._functions.scale_u
        held = by_sample(self.problem.controls, control)
        n = self.problem.horizon
        return Solution(
            status=status,
            control=held,
            controls={name: np.repeat(value[None], n, axis=0) for name, value in held.items()},
            states={},
            cost=np.nan,
            residual=np.inf if outcome is None else _or_infinite(outcome.residual),
            violation=np.inf if outcome is None else _or_infinite(outcome.violation),
            excess=np.inf,
            iterations=0 if outcome is None else outcome.iterations,
            given=None,
            plan=None,
            multipliers=None,
        )

    def _resting(self) -> Array:
        """What is applied, or before anything was 0 as far as fixed limits let it."""
        if self._applied is not None:
            return self._applied
        return self._functions.resting

    def _coming(
        self, vector: Vector, given: Mapping[str, ArrayLike], previewed: int
    ) -> dict[str, Array]:
        """The samples along the horizon: those of a preview, the last one held from there on."""
        names = [member.name for member in vector.members]
        if {*given} != {*names}:
            kind = {"d": "disturbances", "r": "references"}[vector.letter]
            raise ValueError(f"{kind} wanted for {sorted(names)}, given for {sorted(given)}")
        found: dict[str, Array] = {}
        for name in names:
            signal = self.problem.program.signal(name)
            shape = _shape(signal)
            array = np.asarray(given[name], np.float64)
            wanted = (previewed, *shape) if name in self.problem.previewed else shape
            if array.shape != wanted:
                raise ValueError(f"`{name}` has shape {array.shape}, not {wanted}")
            samples = array if name in self.problem.previewed else array[None]
            rows = self.problem.horizon + 1 + self._functions.ahead
            rest = np.repeat(samples[-1:], rows - len(samples), axis=0)
            found[name] = np.concatenate([samples, rest])
        return found


def _shifted(before: Iterate) -> Iterate:
    """The plan of the sample before, as it is from now on; its end is repeated."""

    def later(values: Array) -> Array:
        return np.concatenate([values[1:], values[-1:]])

    def inside(values: Array) -> Array:
        """Stage N lacks limits that stage N−1 has: that one is repeated."""
        return np.concatenate([values[1:-1], values[-2:-1], values[-1:]])

    return Iterate(
        later(before.states),
        later(before.controls),
        inside(before.slacks),
        inside(before.multipliers),
        inside(before.excesses),
        inside(before.excess_multipliers),
    )


def by_sample(vector: Vector, values: Array) -> dict[str, Array]:
    """The quantities of one sample of a vector, (size)."""
    return {name: array[0] for name, array in by_name(vector, values[None]).items()}


def _joined(vector: Vector, values: Mapping[str, ArrayLike], what: str) -> Array:
    names = [member.name for member in vector.members]
    if {*values} != {*names}:
        raise ValueError(f"{what} wanted for {sorted(names)}, given for {sorted(values)}")
    parts: list[Array] = []
    for member in vector.members:
        array = np.asarray(values[member.name], np.float64)
        shape = Type(member.axes).shape
        if array.shape != shape:
            raise ValueError(f"`{member.name}` has shape {array.shape}, not {shape}")
        parts.append(array.ravel())
    return np.concatenate(parts)


def _shape(signal: Signal) -> tuple[int, ...]:
    return Type(signal.axes).shape


def _is_finite(given: Given) -> bool:
    arrays = (given.state, *given.disturbances.values(), *given.references.values())
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def _or_infinite(number: float) -> float:
    return float(number) if np.isfinite(number) else np.inf
