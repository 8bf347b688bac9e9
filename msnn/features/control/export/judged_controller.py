"""Checks an exported controller by the optimality conditions of its plans.

Every plan that it calls solved is given to the interpreter, which knows nothing of the solver.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.types import Type
from compiler.jacobian.matrices import Member
from msnn.agreement.agreement import Agreement, Fault, NotOptimal, SelfTestFails
from msnn.agreement.judgement import FloatType
from msnn.exports.target import Weights
from msnn.features.control.backend.constants import reachable
from msnn.features.control.backend.inputs import SeriesField, input_fields
from msnn.features.control.backend.library import ControllerLibrary, multipliers_of, plan_of
from msnn.features.control.backend.selftest import drawn_starts
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.kkt import Judge
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.trained import trained

_ALLOWED = {"float64": 2.0, "float32": 10.0}
"""By the tolerance: the judge adds up its sums in float64 and in another order."""
_STARTS = 24
_SAMPLES = 4
"""Solved one after the other from each start, each from the plan of the one before."""


def compare_controller(
    problem: ControlProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Checks an exported controller by the optimality conditions of the plans that it reports as
    solved, for random states. `folder` contains its description and the built `controller.so`.

    `one_step` is the largest residual of plans solved without a previous plan, `free_run` that of
    plans solved from the previous plan. Residuals above the tolerance and failed self-tests are
    faults.
    """
    # with learned values as numbers, as the C has them
    problem = trained(problem, weights)
    library = ControllerLibrary.of_folder(folder, folder / "controller.so")
    judge, rows = Judge(problem), rows_of(problem)
    worst = {True: 0.0, False: 0.0}
    count = 0
    for is_cold, x, given, fields in drawn_samples(problem):
        if is_cold:
            library.init()
        decision = library.solve({"x": x} | fields)
        count += 1
        # a plan that is not called solved promises nothing; how many there are is told by
        # self-tests
        if decision.status == 0:
            plan, multipliers = plan_of(problem, library), multipliers_of(problem, rows, library)
            residual = judge.residuals(given, plan, multipliers).largest
            # NaN is worst
            worst[is_cold] = residual if not residual <= worst[is_cold] else worst[is_cold]
    allowed = _ALLOWED[dtype] * reachable(problem.tolerance, dtype)
    residual = max(worst.values()) if all(w == w for w in worst.values()) else float("nan")
    faults: tuple[Fault, ...] = ()
    if not residual <= allowed:
        faults = (NotOptimal("a plan that is called solved", residual, allowed),)
    if bits := library.selftest():
        faults = (*faults, SelfTestFails("the self-test of the controller", bits))
    return Agreement(
        target=target,
        dtype=dtype,
        steps=count,
        one_step=worst[True],
        free_run=worst[False],
        jacobian=None,
        bits=None,
        faults=faults,
        undecided={},
        untried=(),
        rounding={},
    )


def drawn_samples(
    problem: ControlProblem,
) -> Iterator[tuple[bool, NDArray[Any], Given, dict[str, NDArray[Any]]]]:
    """Yields random samples for a controller, each as a tuple of four. The first is True if the
    controller is initialised before the sample. The others are the state x (nx), the values for the
    interpreter, and disturbances and references by field of the C struct.
    """
    random = np.random.default_rng(1)
    fields = {field.name: field for field in input_fields(problem)}
    members = (*problem.disturbances.members, *problem.references.members)
    for start in drawn_starts(problem, _STARTS):
        for number in range(_SAMPLES):
            # the next sample begins near the last one, as that of a plant does
            x = np.array(start) * (1 - 0.1 * number)
            series = {m.name: _series(m, fields[m.name], problem, random) for m in members}
            given = Given(
                x,
                {m.name: series[m.name][0] for m in problem.disturbances.members},
                {m.name: series[m.name][0] for m in problem.references.members},
            )
            by_field = {fields[name].identifier: values for name, (_, values) in series.items()}
            yield number == 0, x, given, by_field


def _series(
    member: Member, field: SeriesField, problem: ControlProblem, random: np.random.Generator
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Random samples of a disturbance or reference: all rows along the horizon, the last one
    repeated, and those in the field of the C struct.
    """
    shape = Type(member.axes).shape
    # the window's samples come along the horizon: the last axis of the struct is time
    one = shape[:-1] if Type(member.axes).window is not None else shape
    known = random.uniform(-0.3, 0.3, (field.samples, *one))
    rows = np.minimum(np.arange(problem.horizon + 1 + field.window), field.samples - 1)
    return known[rows], known
