"""Solves from sample to sample by the controller that `export --to mpc` writes, compiled here."""

from __future__ import annotations

import numpy as np

from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.solution import multipliers_of, plan_of
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.problem.optimal_control.horizon import Array, Given
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.barrier_limits import BarrierLimits
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Found, Solver
from msnn.features.control.run.native_controller import native_controller
from msnn.features.control.run.solution import Status


class CompiledMethod:
    """One instance of the C, in float64; it keeps the plan of its last solve.

    Raises CompilerMissingError and KernelBuildError.
    """

    name: Solver = "c"

    def __init__(self, problem: ControlProblem, functions: HorizonFunctions) -> None:
        self._problem, self._functions = problem, functions
        self._fields, self._rows = input_fields(problem), rows_of(problem)
        self._c = native_controller(problem)

    def forget(self, applied: Array | None) -> None:
        if applied is None:
            self._c.init()
        else:
            self._c.reset(applied)

    def solve(self, given: Given, allowed: ControlRange, resting: Array) -> Found:
        known = {**given.disturbances, **given.references}
        fields = {f.identifier: known[f.name][: f.samples] for f in self._fields}
        decision = self._c.solve({"x": given.state} | fields)
        plan = plan_of(self._problem, self._c)
        with np.errstate(all="ignore"):
            states, controls = self._functions.scaled(plan)
            # the plan of the C is judged by the interpreter, as a plan of Python's is
            values = self._functions.values(given, states, controls)
            violation = BarrierLimits(self._functions, allowed.limits).violation(values)
        return Found(
            status=Status(decision.status),
            plan=plan,
            values=values,
            multipliers=multipliers_of(self._problem, self._rows, self._c),
            residual=decision.residual,
            violation=violation,
            iterations=decision.iterations,
        )
