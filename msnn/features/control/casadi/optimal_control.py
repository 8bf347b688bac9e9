"""Gives an optimal control problem to CasADi's solvers of nonlinear programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi
import numpy as np

from compiler.interpreter.interpreter import Interpreter
from msnn.features.control.casadi.control_program import ConstraintRow, ControlProgram, RowKind
from msnn.features.control.problem.optimal_control.horizon import (
    Array,
    Given,
    LimitsAlong,
    Plan,
    limits_along,
    rates,
    stages_of,
)
from msnn.features.control.problem.optimal_control.problem import ControlProblem

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
    """The plan that CasADi's solver found."""

    succeeded: bool
    cost: float
    """J, penalties included."""
    plan: Plan
    iterations: int


class OptimalControlNlp:
    """An optimal control problem without parameters (`trained`), as one of CasADi's solvers has it.

    `solver` is CasADi's function; `options` are those of `casadi.nlpsol`, beside quiet and a
    tolerance of 1e-9.
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
        """Solves from a plan in the units of the spec."""
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
        """The bounds of variables and constraints, at the references given."""
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
