"""Writes an optimal control problem as a nonlinear program of CasADi, and solves it there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any, Literal

import casadi
import numpy as np

from backends.casadi_function.function import build_function, casadi_names
from backends.casadi_function.lowering import Expression
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.types import Axis, Type
from compiler.jacobian.matrices import Member
from msnn.features.control.problem.horizon import (
    Array,
    Given,
    LimitsAlong,
    Plan,
    block_starts,
    limits_along,
    previous_places,
    rates,
    scales,
    stages_of,
)
from msnn.features.control.problem.optimal_control import ControlProblem, PathLimits


class RowKind(Enum):
    """The kind of a constraint: an equality of the dynamics, the initial state or a held control,
    or a limit.
    """

    GAP = "the next state is that of the plant"
    START = "the first state is the measured one"
    HELD = "a control stays the same within a block"
    RATE = "a control moves no faster"
    LOW = "a soft limit, less its excess"
    HIGH = "a soft limit, and its excess"
    HARD = "a hard limit"

    @property
    def is_equality(self) -> bool:
        return self in (RowKind.GAP, RowKind.START, RowKind.HELD)


@dataclass(frozen=True, slots=True)
class ConstraintRow:
    """One scalar constraint: its kind, stage and element, and for a path limit the index `path` of
    that limit in the problem.
    """

    kind: RowKind
    stage: int
    element: int
    path: int = 0


@dataclass(frozen=True, slots=True)
class _Stage:
    """The slices of the column of variables that a stage has: states, controls (none at N), and
    excesses, the violations of its soft limits.
    """

    states: slice
    controls: slice
    excesses: slice


class ControlProgram:
    """An optimal control problem as a nonlinear program of CasADi, `nlp`. Its variables, column x,
    are states and controls divided by their scales, and violations of soft limits (excesses);
    `rows` are its constraints.
    """

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        self._scale_x, self._scale_u = scales(problem)
        self._step = build_function(problem.program)
        self._names = casadi_names(problem.program)
        self.rows: list[ConstraintRow] = []
        self._stages: list[_Stage] = []
        self._constraints: list[Expression] = []
        self._variables: list[Expression] = []
        self._cost: Expression = casadi.MX(0)
        # x_0 is a variable like the states after it, made equal to this one by a constraint
        state = casadi.MX.sym("state", problem.states.size)
        self._ports = [*problem.disturbances.members, *problem.references.members]
        self._given = {
            member.name: casadi.MX.sym(f"given_{i}", self._rows_of(member) * _size(member.axes))
            for i, member in enumerate(self._ports)
        }
        stages = [self._added_stage(k) for k in range(problem.horizon + 1)]
        for k, (states, controls, excesses) in enumerate(stages):
            values = self._called(states, controls, k)
            if k < problem.horizon:
                parts = [values[self._names.next_states[m.name]] for m in problem.states.members]
                following = casadi.vertcat(*parts) / self._scale_x
                # in this sign: with the other one fatrop does not find the stages
                self._constrain(stages[k + 1][0] - following, RowKind.GAP, k)
                self._cost += values[self._names.outputs[problem.stage]]
            elif problem.terminal is not None:
                self._cost += values[self._names.outputs[problem.terminal]]
            if k == 0:
                self._constrain(states - state / self._scale_x, RowKind.START, 0)
            if k < problem.horizon:
                self._limit_moves(states, controls, k)
            self._limit_paths(values, excesses, k)
        self.nlp = {
            "x": casadi.vertcat(*self._variables),
            "p": casadi.vertcat(state, *self._given.values()),
            "f": self._cost,
            "g": casadi.vertcat(*self._constraints),
        }

    # ---- numbers

    def parameters(self, given: Given) -> Array:
        """The column p of the program's parameters: the measured state, then disturbances and
        references along the horizon.
        """
        known = {**given.disturbances, **given.references}
        parts = [known[member.name][: self._rows_of(member)].ravel() for member in self._ports]
        return np.concatenate([given.state, *parts])

    def start(self, plan: Plan) -> Array:
        """The column x of a plan in the units of the spec, with excesses of 0."""
        found = np.zeros(self._stages[-1].excesses.stop)
        for k, stage in enumerate(self._stages):
            found[stage.states] = plan.states[k] / self._scale_x
            if k < len(plan.controls):
                found[stage.controls] = plan.controls[k] / self._scale_u
        return found

    def plan(self, column: Array) -> Plan:
        """The plan, in the units of the spec, in a column x."""
        states = [column[stage.states] * self._scale_x for stage in self._stages]
        controls = [column[stage.controls] * self._scale_u for stage in self._stages[:-1]]
        return Plan(np.array(states), np.array(controls))

    def with_excesses(self, column: Array) -> Array:
        """A copy of a column x in which negative excesses are 0."""
        found = column.copy()
        for stage in self._stages:
            found[stage.excesses] = np.maximum(found[stage.excesses], 0.0)
        return found

    def variable_bounds(self, low: Array, high: Array) -> tuple[Array, Array]:
        """The lower and upper bounds of the column x. `low` and `high` are the limits of controls
        in the units of the spec, (N, nu).
        """
        size = self._stages[-1].excesses.stop
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        for k, stage in enumerate(self._stages):
            # an excess below 0 would be a gain
            lower[stage.excesses] = 0.0
            if k < len(low):
                lower[stage.controls] = low[k] / self._scale_u
                upper[stage.controls] = high[k] / self._scale_u
        return lower, upper

    # ---- expressions

    def _added_stage(self, k: int) -> tuple[Expression, Expression, dict[int, Expression]]:
        problem = self._problem
        # at N nothing is decided
        controls = problem.controls.size if k < problem.horizon else 0
        excesses = {
            i: casadi.MX.sym(f"v_{k}_{i}", problem.type(path.value).size)
            for i, path in enumerate(problem.path_limits)
            if not path.hard and self._holds(path, k)
        }
        states = casadi.MX.sym(f"x_{k}", problem.states.size)
        moves = casadi.MX.sym(f"u_{k}", controls)
        first = self._stages[-1].excesses.stop if self._stages else 0
        # the variables of a stage stand together: states, controls, excesses
        ends = np.cumsum(
            [first, problem.states.size, controls, sum(int(v.numel()) for v in excesses.values())]
        )
        parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self._stages.append(_Stage(*parts))
        self._variables += [states, moves, *excesses.values()]
        return states, moves, excesses

    def _called(self, states: Expression, controls: Expression, k: int) -> dict[str, Expression]:
        """The results of the step at stage k, by name. At N it reads controls of 0, on which
        nothing depends.
        """
        problem = self._problem
        last = k == problem.horizon
        moves = casadi.MX.zeros(problem.controls.size) if last else controls * self._scale_u
        physical = states * self._scale_x
        arguments = {self._names.states[m.name]: _part(physical, m) for m in problem.states.members}
        arguments |= {self._names.inputs[m.name]: _part(moves, m) for m in problem.controls.members}
        arguments |= {
            self._names.inputs[m.name]: _samples(self._given[m.name], k, m.axes)
            for m in self._ports
        }
        # a port that nothing reads is no argument of the function
        known = {*self._step.name_in()}
        return self._step.call({name: v for name, v in arguments.items() if name in known})

    def _limit_moves(self, states: Expression, controls: Expression, k: int) -> None:
        places, most = previous_places(self._problem), rates(self._problem)
        is_start = bool(block_starts(self._problem)[k])
        for j, place in enumerate(places.tolist()):
            if place >= 0 and (np.isfinite(most[j]) or not is_start):
                before = states[place] * self._scale_x[place]
                moved = controls[j] * self._scale_u[j] - before
                self._constrain(moved, RowKind.RATE if is_start else RowKind.HELD, k, j)

    def _limit_paths(
        self, values: dict[str, Expression], excesses: dict[int, Expression], k: int
    ) -> None:
        for i, path in enumerate(self._problem.path_limits):
            if not self._holds(path, k):
                continue
            value = values[self._names.outputs[path.value]] / path.scale
            if path.hard:
                self._constrain(value, RowKind.HARD, k, path=i)
                continue
            assert path.linear is not None
            assert path.quadratic is not None
            excess = excesses[i]
            # scaled excesses cost the same: w₁ e = w₁ s (e/s)
            self._cost += path.linear * path.scale * casadi.sum1(excess)
            self._cost += path.quadratic * path.scale**2 * casadi.sumsqr(excess)
            # two rows of one excess: min ≤ g + v and g − v ≤ max
            self._constrain(value + excess, RowKind.LOW, k, path=i)
            self._constrain(value - excess, RowKind.HIGH, k, path=i)

    def _constrain(
        self, value: Expression, kind: RowKind, k: int, element: int = 0, path: int = 0
    ) -> None:
        self._constraints.append(value)
        self.rows += [ConstraintRow(kind, k, element + i, path) for i in range(int(value.numel()))]

    def _holds(self, path: PathLimits, k: int) -> bool:
        stages = stages_of(self._problem, path)
        return (stages.start or 0) <= k < stages.stop

    def _rows_of(self, member: Member) -> int:
        """The number of samples of a disturbance or reference that are parameters of
        the program.
        """
        # N stages, and as many samples more as a window looks ahead of the last one
        return self._problem.horizon + (Type(member.axes).window or 1)


def _part(column: Expression, member: Member) -> Expression:
    return column[member.first : member.first + member.size]


def _size(axes: Sequence[Axis]) -> int:
    """The number of elements in one sample of a port with these axes."""
    type = Type(tuple(axes))
    return type.size // (type.window or 1)


def _samples(column: Expression, k: int, axes: Sequence[Axis]) -> Any:
    """The samples of a port that stage k reads, in the order of the port: its window is the last
    axis. `column` has all samples, one after the other.
    """
    size, window = _size(axes), Type(tuple(axes)).window or 1
    # samples first in memory, the window last in a port: the transpose turns one into the other
    return casadi.vec(casadi.reshape(column[k * size : (k + window) * size], size, window).T)


NlpSolver = Literal["ipopt", "fatrop"]
_OPTIONS: dict[NlpSolver, dict[str, Any]] = {
    "ipopt": {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9},
    "fatrop": {
        "print_time": False,
        "structure_detection": "auto",
        "fatrop.print_level": 0,
        "fatrop.tol": 1e-9,
    },
}


@dataclass(frozen=True, slots=True)
class NlpSolution:
    """The result of CasADi's solver; `succeeded` is False if it did not converge."""

    succeeded: bool
    cost: float
    """J, penalties included."""
    plan: Plan
    iterations: int


class OptimalControlNlp:
    """An optimal control problem without parameters (`trained`) for a solver of CasADi.

    `solver` names IPOPT or fatrop; `options` are passed to `casadi.nlpsol`, in addition to quiet
    output and a tolerance of 1e-9. The attribute `solver` is CasADi's function.
    """

    def __init__(
        self,
        problem: ControlProblem,
        solver: NlpSolver = "ipopt",
        options: Mapping[str, Any] | None = None,
    ) -> None:
        self.problem = problem
        self._interpreter = Interpreter(problem.program)
        self._program = ControlProgram(problem)
        settings = _OPTIONS[solver] | dict(options or {})
        if solver == "fatrop":
            # fatrop must be told which constraints are equalities; IPOPT sees it by the bounds
            settings["equality"] = [row.kind.is_equality for row in self._program.rows]
        nlp = self._program.nlp
        # the cost at what is returned, after excesses are put right
        self._cost = casadi.Function("cost", [nlp["x"], nlp["p"]], [nlp["f"]])
        self.solver: casadi.Function = casadi.nlpsol(
            "controller", solver, self._program.nlp, settings
        )

    def solve(self, given: Given, plan: Plan) -> NlpSolution:
        """Solves the problem for the values `given`, starting from a plan in the units of the spec.
        A solver that does not converge is reported in the result.
        """
        program = self._program
        p = program.parameters(given)
        found = self.solver(x0=program.start(plan), p=p, **self._bounds(given))
        # both solvers let bounds go by 1e-8: an excess below 0, times a steep penalty, is a gain
        column = program.with_excesses(np.array(found["x"]).ravel())
        stats = self.solver.stats()
        return NlpSolution(
            bool(stats["success"]),
            float(self._cost(column, p)),
            program.plan(column),
            int(stats.get("iter_count", 0)),
        )

    def _bounds(self, given: Given) -> dict[str, Array]:
        """The bounds of variables and constraints for these values of the references, as arguments
        of the solver.
        """
        along = limits_along(self.problem, self._interpreter, given)
        lower, upper = self._program.variable_bounds(along.control_min, along.control_max)
        ends = [self._ends(row, along) for row in self._program.rows]
        low, high = (np.array([end[side] for end in ends]) for side in (0, 1))
        return {"lbx": lower, "ubx": upper, "lbg": low, "ubg": high}

    def _ends(self, row: ConstraintRow, along: LimitsAlong) -> tuple[float, float]:
        if row.kind.is_equality:
            return 0.0, 0.0
        if row.kind is RowKind.RATE:
            most = float(rates(self.problem)[row.element])
            return -most, most
        path = self.problem.path_limits[row.path]
        # rows of a path begin at its first stage
        at = row.stage - (stages_of(self.problem, path).start or 0)
        low = float(along.path_min[row.path][at, row.element]) / path.scale
        high = float(along.path_max[row.path][at, row.element]) / path.scale
        match row.kind:
            case RowKind.LOW:
                return low, np.inf
            case RowKind.HIGH:
                return -np.inf, high
            case _:
                return low, high
