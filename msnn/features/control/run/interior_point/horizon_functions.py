"""Evaluates an optimal control problem and its derivatives along a horizon, in scaled variables.

Stage k has the variables (x_k, u_k) divided by their scales, and rows h of limits: controls, their
moves u_k − u_{k−1}, then path limits, each divided by its scale. Arrays of all stages have N+1
entries first; what a stage lacks is 0 there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from compiler.hessian.step_derivatives import (
    DerivativeInterpreter,
    multiplier,
    next_value,
    step_derivatives,
)
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import Constant
from compiler.ir.types import Type
from compiler.jacobian.matrices import by_name
from msnn.features.control.problem.cost_scale import with_scaled_cost
from msnn.features.control.problem.horizon import (
    Array,
    Given,
    Multipliers,
    Plan,
    block_starts,
    flat,
    limits_along,
    limits_program,
    log_of,
    previous_places,
    rates,
    scales,
    stages_of,
)
from msnn.features.control.problem.optimal_control import ControlProblem, Limits
from msnn.features.control.problem.structure import chosen_structure
from msnn.features.control.run.interior_point.newton_step import HeldControls


class HorizonFunctions:
    """The functions of one problem, compiled once and evaluated for any plan; `given` are the
    values that are known at t.
    """

    def __init__(self, problem: ControlProblem) -> None:
        self.cost_scale = problem.cost_scale
        # of σJ from here on, but for what is told in the units of the spec
        problem = with_scaled_cost(problem)
        self.problem = problem
        self.horizon = problem.horizon
        self.structure = chosen_structure(problem)
        self.scale_x, self.scale_u = scales(problem)
        self.states, self.controls = problem.states.size, problem.controls.size
        self.starts = block_starts(problem)
        self.interpreter = Interpreter(problem.program)
        self._limiting = Interpreter(limits_program(problem))
        self._places, self._rates = previous_places(problem), rates(problem)
        self._sizes = [problem.type(path.value).size for path in problem.path_limits]
        self._terminal = problem.terminal
        names = [problem.stage, *(path.value for path in problem.path_limits)]
        names += [] if self._terminal is None else [self._terminal]
        self._outputs = list(dict.fromkeys(names))
        controls = [member.name for member in problem.controls.members]
        self._derivatives = step_derivatives(
            problem.program, inputs=controls, outputs=self._outputs, flat=problem.flat
        )
        self._curved = DerivativeInterpreter(self._derivatives, problem.program)
        # line searches and residuals want slopes without the Hessian, by far the larger part
        first_only = step_derivatives(
            problem.program, inputs=controls, outputs=self._outputs, hessian=False
        )
        self._sloped = DerivativeInterpreter(first_only, problem.program)
        known = self._derivatives.variables
        wanted = [*problem.states.members, *problem.controls.members]
        first = [known.member(m.name).first for m in wanted]
        # derivatives are in the program's order of signals, x and u in the spec's
        self._columns = np.concatenate(
            [np.arange(m.size) + at for m, at in zip(wanted, first, strict=True)]
        ).astype(np.int64)
        # everything is relative to scales: tolerance and barrier are then the same for all problems
        self._scale = np.concatenate([self.scale_x, self.scale_u])
        paths = zip(problem.path_limits, self._sizes, strict=True)
        of_paths = [np.full(size, path.scale) for path, size in paths]
        self._row_scale = np.concatenate([self.scale_u, self.scale_u, *of_paths])

        # the last sample of a port read ahead
        windows = [Type(member.axes).window for member in problem.disturbances.members]
        self.ahead = max((window - 1 for window in windows if window is not None), default=0)
        ends = [_fixed_ends(problem, control.limits) for control in problem.control_limits]
        resting = [
            # what lies still: 0, or the nearest that is allowed
            np.full(member.size, min(max(0.0, low), high))
            for member, (low, high) in zip(problem.controls.members, ends, strict=True)
        ]
        self.resting = np.concatenate(resting)
        selection = np.zeros((self.controls, self.states))
        known_before = self._places >= 0
        places = self._places[known_before]
        # scaled u_{k−1} from scaled x: the ratio of the two scales
        ratio = self.scale_x[places] / self.scale_u[known_before]
        selection[known_before, places] = ratio
        self.held = HeldControls(~self.starts, selection)

    # ---- plans

    def scaled(self, plan: Plan) -> tuple[Array, Array]:
        return plan.states / self.scale_x, plan.controls / self.scale_u

    def plan(self, states: Array, controls: Array) -> Plan:
        """The plan in the units of the spec, from scaled states (N+1, nx) and controls (N, nu)."""
        return Plan(states * self.scale_x, controls * self.scale_u)

    def rollout(self, given: Given, controls: Array) -> Array:
        """Simulates the plant with scaled controls (N, nu); returns the scaled states (N+1, nx)."""
        state = given.state[None]
        found = [state]
        log = log_of(self.problem, given, controls * self.scale_u)
        # one stage after the other: each needs the state of the one before
        for k in range(self.horizon):
            named = by_name(self.problem.states, state)
            values = self.interpreter.step(log, k, named, losses=False)
            state = self._joined(values.next_states, 1)
            found.append(state)
        return np.concatenate(found) / self.scale_x

    # ---- limits

    def limits(self, given: Given) -> RowLimits:
        """The scaled limits of all rows, for the references in `given`."""
        n, nu = self.horizon, self.controls
        along = limits_along(self.problem, self._limiting, given)
        size = 2 * nu + sum(self._sizes)
        low, high = np.full((n + 1, size), -np.inf), np.full((n + 1, size), np.inf)
        low[:n, :nu], high[:n, :nu] = along.control_min, along.control_max
        # where a block goes on there is no move to limit: the control is held
        move = np.where(self.starts[:, None], self._rates, np.inf)
        low[:n, nu : 2 * nu], high[:n, nu : 2 * nu] = -move, move
        linear, quadratic = np.full(size, np.inf), np.zeros(size)
        for i, (path, rows) in enumerate(zip(self.problem.path_limits, self._rows(), strict=True)):
            stages = stages_of(self.problem, path)
            low[stages, rows], high[stages, rows] = along.path_min[i], along.path_max[i]
            if not path.hard:
                assert path.linear is not None
                assert path.quadratic is not None
                # of scaled excess e/s: w₁ e = (w₁ s)(e/s) and w₂ e² = (w₂ s²)(e/s)²
                linear[rows] = path.linear * path.scale
                quadratic[rows] = path.quadratic * path.scale**2
        return RowLimits(low / self._row_scale, high / self._row_scale, linear, quadratic)

    def _rows(self) -> list[slice]:
        first = 2 * self.controls
        found: list[slice] = []
        for size in self._sizes:
            found.append(slice(first, first + size))
            first += size
        return found

    def multipliers(self, scaled: Array) -> Multipliers:
        """The multipliers in the units of the spec, from scaled ones of all rows, (N+1, 2m), first
        those of minima.
        """
        n, nu, size = self.horizon, self.controls, len(self._row_scale)
        # a multiplier is cost by unit of the limit: scaled limits and costs have scaled ones
        unit = self._row_scale * self.cost_scale
        low, high = scaled[:, :size] / unit, scaled[:, size:] / unit
        paths = list(zip(self.problem.path_limits, self._rows(), strict=True))
        return Multipliers(
            control_min=low[:n, :nu],
            control_max=high[:n, :nu],
            rate_min=low[:n, nu : 2 * nu],
            rate_max=high[:n, nu : 2 * nu],
            path_min=tuple(low[stages_of(self.problem, path), rows] for path, rows in paths),
            path_max=tuple(high[stages_of(self.problem, path), rows] for path, rows in paths),
        )

    def cost(self, limits: RowLimits, values: Values) -> tuple[float, float]:
        """The cost J with penalties, as the spec defines it, and the largest violation of soft
        limits, scaled.
        """
        rows = values.rows
        excess = np.maximum(np.maximum(limits.low - rows, rows - limits.high), 0.0)
        soft = np.isfinite(limits.linear)
        excess = excess[:, soft]
        cost = limits.linear[soft] * excess + limits.quadratic[soft] * excess**2
        whole = values.cost + float(np.sum(cost))
        return whole / self.cost_scale, float(np.max(excess, initial=0.0))

    # ---- values

    def values(self, given: Given, states: Array, controls: Array) -> Values:
        """The cost, next states and rows of limits at a scaled plan."""
        plan = self.plan(states, controls)
        log = log_of(self.problem, given, plan.controls)
        named = by_name(self.problem.states, plan.states)
        every = np.arange(self.horizon + 1)
        found = self.interpreter.step(log, every, named, losses=False)
        return Values(
            self._cost(found.outputs),
            # the next states of stage N belong to nothing
            self._joined(found.next_states, self.horizon + 1)[:-1] / self.scale_x,
            self._limited(found.outputs, plan),
        )

    def slopes(self, given: Given, states: Array, controls: Array) -> Slopes:
        """The first derivatives of cost, next states and rows at a scaled plan."""
        plan = self.plan(states, controls)
        log = log_of(self.problem, given, plan.controls)
        named = by_name(self.problem.states, plan.states)
        found = self._sloped.values(log, np.arange(self.horizon + 1), named).matrices["J"]
        return self._slopes(found[:, :, self._columns] * self._scale)

    def curvature(
        self, given: Given, states: Array, controls: Array, rows: Array, costates: Array
    ) -> Array:
        """The Hessian of J + λᵀF + yᵀh by stage at a scaled plan, (N+1, nx+nu, nx+nu).

        `rows` are the weights y of the rows h, (N+1, m). `costates` are the weights λ_{k+1} of
        the next states F at stage k, (N, nx). All are scaled.
        """
        problem, n = self.problem, self.horizon
        plan = self.plan(states, controls)
        log = log_of(problem, given, plan.controls)
        of_paths = dict(
            zip([path.value for path in problem.path_limits], self._rows(), strict=True)
        )
        of_states = {next_value(member.name): member for member in problem.states.members}
        weights = {name: np.zeros((n + 1, 1)) for name in (problem.stage, self._terminal)}
        # each stage computes every output; those that are not of its cost have the weight 0
        weights[problem.stage][:n] = 1.0
        if self._terminal is not None:
            weights[self._terminal][n] = 1.0
        multipliers: dict[str, Array] = {}
        for member in self._derivatives.results.members:
            if member.name in of_paths:
                columns = of_paths[member.name]
                # rows are g/s: yᵀh is (y/s)ᵀg
                weight = rows[:, columns] / self._row_scale[columns]
            elif member.name in of_states:
                first = of_states[member.name].first
                columns = slice(first, first + member.size)
                weight = np.zeros((n + 1, member.size))
                # λᵀ of scaled next states, as above
                weight[:n] = costates[:, columns] / self.scale_x[columns]
            else:
                weight = weights[member.name]
            multipliers[multiplier(member.name)] = weight.reshape(
                -1, *(a.size for a in member.axes)
            )
        named = by_name(problem.states, plan.states) | multipliers
        found = self._curved.values(log, np.arange(n + 1), named).matrices["H"]
        return found[:, self._columns][:, :, self._columns] * self._scale * self._scale[:, None]

    def _slopes(self, jacobian: Array) -> Slopes:
        problem, n, nx, nu = self.problem, self.horizon, self.states, self.controls
        results = self._derivatives.results

        def part(name: str) -> Array:
            member = results.member(name)
            return jacobian[:, member.first : member.first + member.size]

        cost = part(problem.stage)[:, 0].copy()
        # at N the terminal cost, and no control
        cost[n] = 0.0 if self._terminal is None else part(self._terminal)[n, 0]
        cost[n, nx:] = 0.0
        following = [part(next_value(member.name)) for member in problem.states.members]
        along = np.concatenate([*following, np.empty((n + 1, 0, nx + nu))], axis=1)[:n]
        rows = np.zeros((n + 1, len(self._row_scale), nx + nu))
        every = np.arange(nu)
        rows[:n, every, nx + every] = 1.0
        # of a move: 1 by the control, minus the ratio by the state that holds the one before
        rows[:n, nu + every, nx + every] = 1.0
        rows[:n, nu : 2 * nu, :nx] -= self.held.selection
        for path, columns in zip(problem.path_limits, self._rows(), strict=True):
            stages = stages_of(problem, path)
            rows[stages, columns] = part(path.value)[stages] / path.scale
        return Slopes(cost, along / self.scale_x[:, None], rows)

    def _cost(self, outputs: dict[str, Array]) -> float:
        # stage costs to N−1, the terminal one at N
        total = float(np.sum(outputs[self.problem.stage][:-1]))
        return total if self._terminal is None else total + float(outputs[self._terminal][-1])

    def _limited(self, outputs: dict[str, Array], plan: Plan) -> Array:
        n, nu = self.horizon, self.controls
        rows = np.zeros((n + 1, len(self._row_scale)))
        rows[:n, :nu] = plan.controls
        held = self._places >= 0
        rows[:n, nu : 2 * nu][:, held] = (
            plan.controls[:, held] - plan.states[:n, self._places[held]]
        )
        for path, columns in zip(self.problem.path_limits, self._rows(), strict=True):
            stages = stages_of(self.problem, path)
            rows[stages, columns] = flat(outputs[path.value])[stages]
        return rows / self._row_scale

    def _joined(self, values: dict[str, Array], rows: int) -> Array:
        parts = [flat(values[member.name]) for member in self.problem.states.members]
        return np.concatenate([*parts, np.empty((rows, 0))], axis=1)


def _fixed_ends(problem: ControlProblem, limits: Limits) -> tuple[float, float]:
    """The minimum and maximum if they are constant; −∞ and +∞ for others."""
    found: list[float] = []
    for name, nothing in ((limits.minimum, -np.inf), (limits.maximum, np.inf)):
        op = None if name is None else problem.program.step[problem.node(name)].op
        found.append(op.values[0] if isinstance(op, Constant) else nothing)
    return found[0], found[1]


@dataclass(frozen=True, slots=True)
class Values:
    """The values of one plan, in scaled variables."""

    cost: float
    """σJ without penalties."""
    following: Array
    """F(x_k, u_k), (N, nx)."""
    rows: Array
    """h, (N+1, m)."""

    @property
    def are_finite(self) -> bool:
        """True if all values are finite; a square root of a negative value, say, is not."""
        return all(bool(np.isfinite(v).all()) for v in (self.cost, self.following, self.rows))


@dataclass(frozen=True, slots=True)
class Slopes:
    """The first derivatives at one plan, in scaled variables."""

    cost: Array
    """∂σJ/∂(x_k, u_k), (N+1, nx+nu)."""
    following: Array
    """∂F/∂(x_k, u_k), (N, nx, nx+nu)."""
    rows: Array
    """∂h/∂(x_k, u_k), (N+1, m, nx+nu)."""


@dataclass(frozen=True, slots=True)
class RowLimits:
    """The scaled limits of the rows h: minimum and maximum, ∓∞ where there is none, and the linear
    and quadratic cost of violating them.

    Limits are (N+1, m), costs (m); a hard row has the linear cost ∞.
    """

    low: Array
    high: Array
    linear: Array
    quadratic: Array

    @property
    def are_numbers(self) -> bool:
        """True if no limit is NaN, which a computed limit may be even for finite references."""
        return not bool(np.any(np.isnan(self.low)) or np.any(np.isnan(self.high)))

    @property
    def can_be_met(self) -> bool:
        """True if each limit can be met: no lower one is +∞, no upper one −∞, none is NaN."""
        return bool(np.all(self.low < np.inf) and np.all(self.high > -np.inf))

    def without_unmet(self) -> RowLimits:
        """A copy in which limits that no value can meet (a minimum +∞, a maximum −∞, NaN) are
        removed.
        """
        low = np.where(self.low < np.inf, self.low, -np.inf)
        return replace(self, low=low, high=np.where(self.high > -np.inf, self.high, np.inf))
