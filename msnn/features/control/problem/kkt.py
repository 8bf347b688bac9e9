"""Judges a solution of an optimal control problem by its optimality conditions.

Nothing of a solver is used: values and slopes are those of the interpreter, costates follow from
the plan by λ_k = ∂(l + zᵀg)/∂x + Aᵀ λ_{k+1}, backwards from λ_N. With the scales s of the problem,

    dynamics         |x_{k+1} − F(x_k, u_k)| / s
    stationarity     |∂L/∂u_k| · s, summed over a block
    bounds           how far u, u_k − u_{k−1} and hard g are beyond their limits, / s
    complementarity  z · distance to the limit, and −z · s where z < 0

For a soft limit exceeded by v ≥ 0 the multiplier is w₁ + 2 w₂ v where v > 0, and at most w₁ where
v = 0: complementarity has |z − w₁ − 2 w₂ v| · v and (z − w₁) · s. Stationarity and complementarity
are multiplied by the cost scale σ of the problem, as they are compared with a tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.jacobian.matrices import Vector, by_name
from msnn.features.control.problem.horizon import (
    Array,
    Given,
    LimitsAlong,
    Multipliers,
    Plan,
    block_starts,
    flat,
    limits_along,
    log_of,
    previous_places,
    rates,
    scales,
    stages_of,
)
from msnn.features.control.problem.optimal_control import ControlProblem


@dataclass(frozen=True, slots=True)
class Residuals:
    """The largest violation of each kind of optimality condition; NaN if any value is NaN."""

    dynamics: float
    stationarity: float
    bounds: float
    complementarity: float

    @property
    def largest(self) -> float:
        """The largest of the four; NaN if one is NaN."""
        parts = (self.dynamics, self.stationarity, self.bounds, self.complementarity)
        return float(np.max(parts))


class Judge:
    """Computes residuals of the optimality conditions (KKT) of one control problem.

    A plan is a trajectory of states and inputs. The derivatives are built once, for many plans.
    """

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        self._interpreter = Interpreter(problem.program)
        self._slopes = jacobian(problem.program)
        self._jacobian = JacobianInterpreter(self._slopes, problem.program)

    def residuals(self, given: Given, plan: Plan, multipliers: Multipliers) -> Residuals:
        """The residuals of the optimality conditions at a plan with these multipliers, for the
        values `given`.
        """
        # a plan that leads to ∞ or NaN is judged: its residual is NaN, which is no warning
        with np.errstate(all="ignore"):
            return self._judged(given, plan, multipliers).residuals()

    def _judged(self, given: Given, plan: Plan, multipliers: Multipliers) -> _Judged:
        problem, interpreter = self._problem, self._interpreter
        log, rows = log_of(problem, given, plan.controls), np.arange(problem.horizon + 1)
        states = by_name(problem.states, plan.states)
        values = interpreter.step(log, rows, states, losses=False)
        names = [member.name for member in problem.states.members]
        following = [flat(values.next_states[name]) for name in names]
        found = self._jacobian.matrices(log, rows, states)
        columns = _columns(problem.controls, self._slopes.inputs)
        return _Judged(
            problem=problem,
            given=given,
            plan=plan,
            multipliers=multipliers,
            limits=limits_along(problem, interpreter, given),
            # a plant without memory has no next states, and concatenating nothing is an error
            following=np.concatenate([*following, np.empty((len(rows), 0))], axis=1),
            outputs={name: flat(value) for name, value in values.outputs.items()},
            A=found["A"],
            B=found["B"][:, :, columns],
            C=found["C"],
            D=found["D"][:, :, columns],
            rows_of=self._slopes.outputs,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judged:
    problem: ControlProblem
    given: Given
    plan: Plan
    multipliers: Multipliers
    limits: LimitsAlong
    following: Array
    outputs: dict[str, Array]
    A: Array
    B: Array
    C: Array
    D: Array
    rows_of: Vector

    def residuals(self) -> Residuals:
        x, n = self.plan.states, self.problem.horizon
        scale_x, scale_u = scales(self.problem)
        # x_0 is part of the plan: it has to be what was measured
        gaps = np.concatenate([x[:1] - self.given.state, x[1:] - self.following[:n]])
        bounds, products = self._limits()
        return Residuals(
            dynamics=greatest(gaps / scale_x),
            stationarity=greatest(self._gradient() * scale_u) * self.problem.cost_scale,
            bounds=greatest(bounds),
            complementarity=greatest(products) * self.problem.cost_scale,
        )

    def _slopes_of(self, output: str) -> tuple[Array, Array]:
        """The Jacobians of an output with respect to x and u along the horizon, (N+1, size, nx) and
        (N+1, size, nu).
        """
        member = self.rows_of.member(output)
        rows = slice(member.first, member.first + member.size)
        return self.C[:, rows], self.D[:, rows]

    def _gradient(self) -> Array:
        """∂L/∂u by block, (N, nu): the sum over a block at its first stage, 0 at the others."""
        problem, z = self.problem, self.multipliers
        n = problem.horizon
        by_x, by_u = (slope[:, 0].copy() for slope in self._slopes_of(problem.stage))
        # at N the stage cost does not count, and no control is there to decide
        by_x[n], by_u[n] = 0.0, 0.0
        if problem.terminal is not None:
            by_x[n] = self._slopes_of(problem.terminal)[0][n, 0]
        for path, low, high in zip(problem.path_limits, z.path_min, z.path_max, strict=True):
            stages = stages_of(problem, path)
            of_x, of_u = self._slopes_of(path.value)
            # the gradient of −z_minᵀ(g − g_min) − z_maxᵀ(g_max − g)
            by_x[stages] += np.einsum("ks,ksx->kx", high - low, of_x[stages])
            by_u[stages] += np.einsum("ks,ksu->ku", high - low, of_u[stages])
        rate = z.rate_max - z.rate_min
        by_u[:n] += z.control_max - z.control_min + rate
        places = previous_places(problem)
        held = places >= 0
        costate = by_x[n]
        gradient = np.zeros((n, problem.controls.size))
        for k in range(n - 1, -1, -1):
            gradient[k] = by_u[k] + self.B[k].T @ costate
            costate = by_x[k] + self.A[k].T @ costate
            # u_{k−1} stands in x_k: what limits the move limits the control of the stage before too
            costate[places[held]] -= rate[k][held]
        starts = block_starts(problem)
        # within a block there is one control: its gradient is the sum over its samples
        for k in range(n - 1, 0, -1):
            if not starts[k]:
                gradient[k - 1] += gradient[k]
                gradient[k] = 0.0
        return gradient

    def _limits(self) -> tuple[Array, Array]:
        """Violations of the limits and complementarity products, concatenated."""
        problem, z, u = self.problem, self.multipliers, self.plan.controls
        x, scale_u = self.plan.states, scales(problem)[1]
        exceeded: list[Array] = []
        products: list[Array] = []

        def hard(distance: Array, multiplier: Array, scale: Array | float) -> None:
            real = np.isfinite(distance)
            # ∞ is no limit, and no distance to one
            exceeded.append(np.maximum(-distance / scale, 0.0)[real])
            products.append((np.abs(distance) * multiplier)[real])
            products.append(np.ravel(np.maximum(-multiplier, 0.0) * scale))
            # where NaN is the limit or the value, nothing is kept
            exceeded.append(np.where(np.isnan(distance), np.nan, 0.0).ravel())
            # without a limit there is nothing that a multiplier could multiply
            products.append(np.where(real, 0.0, multiplier).ravel())

        hard(u - self.limits.control_min, z.control_min, scale_u)
        hard(self.limits.control_max - u, z.control_max, scale_u)
        places, most = previous_places(problem), rates(problem)
        moved, held = np.zeros_like(u), places >= 0
        moved[:, held] = u[:, held] - x[:-1, places[held]]
        hard(moved + most, z.rate_min, scale_u)
        hard(most - moved, z.rate_max, scale_u)
        # a control may not move within its block: a limit of width 0
        exceeded.append((np.abs(moved) / scale_u)[~block_starts(problem)].ravel())
        for i, path in enumerate(problem.path_limits):
            value = self.outputs[path.value][stages_of(problem, path)]
            for distance, multiplier in (
                (value - self.limits.path_min[i], z.path_min[i]),
                (self.limits.path_max[i] - value, z.path_max[i]),
            ):
                if path.hard:
                    hard(distance, multiplier, path.scale)
                    continue
                assert path.linear is not None
                assert path.quadratic is not None
                # what is beyond costs, and is no fault: the limit that counts is moved by v
                beyond = np.maximum(-distance, 0.0)
                steepest = path.linear + 2 * path.quadratic * beyond
                hard(distance + beyond, multiplier, path.scale)
                products.append((np.abs(multiplier - steepest) * beyond).ravel())
                products.append(np.ravel(np.maximum(multiplier - steepest, 0.0)) * path.scale)
        return np.concatenate(exceeded), np.concatenate(products)


def _columns(controls: Vector, inputs: Vector) -> list[int]:
    """The index of each element of u among those of all inputs of the Jacobian."""
    return [
        inputs.member(member.name).first + number
        for member in controls.members
        for number in range(member.size)
    ]


def greatest(values: Array) -> float:
    """The largest magnitude in an array; 0 for an empty one, NaN if it contains NaN."""
    return float(np.max(np.abs(values), initial=0.0))
