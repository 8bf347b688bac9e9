"""Solves by the C controller of `export --to mpc`, compiled on this computer."""

from __future__ import annotations

import json

import numpy as np

from backends.native.compile_kernel import compiled_kernel
from backends.native.native_step import one_text
from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.library import ControllerLibrary, multipliers_of, plan_of
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.backend.write_controller import controller_texts
from msnn.features.control.problem.horizon import Array, Given, Plan
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.barrier_problem import BarrierLimits
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Found, Solver, Status


class CompiledMethod:
    """Solves by one instance of the generated C controller in float64, which stores the plan of its
    last solve.

    Creating it raises CompilerMissingError without a C compiler, and KernelBuildError if the code
    does not compile.
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
        status, plan = Status(decision.status), plan_of(self._problem, self._c)
        # in place of that of an infeasible plan the C returns the control of before
        if status <= Status.CAPPED:
            plan = self._within(plan, allowed, decision.control)
        states, controls = self._functions.scaled(plan)
        with np.errstate(all="ignore"):
            # the plan of the C is judged by the interpreter, as a plan of Python's is
            values = self._functions.values(given, states, controls)
            violation = BarrierLimits(self._functions, allowed.limits).violation(values)
        if status is Status.CAPPED:
            violation = allowed.violation(given, controls)
        return Found(
            status=status,
            plan=plan,
            values=values,
            multipliers=multipliers_of(self._problem, self._rows, self._c),
            residual=decision.residual,
            violation=violation,
            iterations=decision.iterations,
        )

    def _within(self, plan: Plan, allowed: ControlRange, applied: Array) -> Plan:
        """The plan with the control `applied`, which the C code returned, as its first one, and
        later controls clipped to their limits.

        A plan that is not solved may break limits of rates; the C code limits the control that it
        returns.
        """
        scale = self._functions.scale_u
        controls = plan.controls / scale
        controls[0] = applied / scale
        nearest = allowed.nearest(controls)
        # a control that stays is the same to the bit
        kept = np.where(nearest == controls, plan.controls, nearest * scale)
        return Plan(plan.states, np.concatenate([applied[None], kept[1:]]))


_PREFIX = "plant"


def native_controller(problem: ControlProblem) -> ControllerLibrary:
    """Compiles the C controller of a problem without parameters, in float64.

    Raises CompilerMissingError without a C compiler, and KernelBuildError if the code does not
    compile.
    """
    texts = controller_texts(problem, _PREFIX, "float64")
    about = json.loads(texts[f"{_PREFIX}_mpc.json"])
    return ControllerLibrary(about, compiled_kernel(one_text(texts)).library)
