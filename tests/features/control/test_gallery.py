"""Plants of the gallery: both controllers, ipopt and fatrop find the same optimum."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import msnn
from compiler.ir.ops import Constant
from compiler.passes.smooth_kinks import smooth_kinks
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.trained import trained
from msnn.features.control.run.compiled_method import CompiledMethod
from msnn.features.control.run.controller import Controller
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Solver
from msnn.model.weights.weights_file import initial_weights
from tests.features.control.gallery_problems import PROBLEMS

SOLVERS = (None, "python")
KINKED = {"quarter_car"}
"""Whose optimum lies on a kink, where no solver of smooth problems gets to the tolerance."""


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", sorted(PROBLEMS.keys() - KINKED))
def test_solved_at_the_cost_of_ipopt_and_fatrop(
    name: str, solver: Solver | None, tmp_path: Path
) -> None:
    problem = PROBLEMS[name]
    controller = msnn.mpc(problem.model(name, tmp_path), solver=solver)
    given = {"references": problem.references, "disturbances": problem.disturbances}
    found = controller.solve(problem.x, **given)
    assert found.status == 0
    # the judge's own slopes and costates: what the solver says of itself, told apart from it
    assert controller.residuals(found).largest <= 1.001e-6
    assert found.given is not None
    assert found.plan is not None
    for name_of_other in ("ipopt", "fatrop"):
        other = controller.casadi(name_of_other).solve(found.given, found.plan)
        # KKT 1e-6 leaves some 1e-6 · rows of the cost; fatrop may call a last step too small
        assert found.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6), name_of_other


@pytest.mark.parametrize("name", sorted(KINKED))
def test_a_kink_made_smooth_is_solved_at_the_cost_of_ipopt(name: str, tmp_path: Path) -> None:
    problem = PROBLEMS[name]
    control = problem.model(name, tmp_path).of(ControlProblem)
    assert control is not None
    known = trained(control, initial_weights(control.program))
    smooth = replace(known, program=smooth_kinks(known.program))
    functions = HorizonFunctions(smooth)
    controller = Controller(smooth, functions, CompiledMethod(smooth, functions))
    given = {"references": problem.references, "disturbances": problem.disturbances}
    found = controller.solve(problem.x, **given)
    assert found.status == 0
    assert controller.residuals(found).largest <= 1.001e-6
    assert found.given is not None
    assert found.plan is not None
    other = controller.casadi("ipopt").solve(found.given, found.plan)
    assert found.cost == pytest.approx(other.cost, rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_closed_loop_stays_within_limits(name: str, solver: Solver | None, tmp_path: Path) -> None:
    problem = PROBLEMS[name]
    controller = msnn.mpc(problem.model(name, tmp_path), solver=solver)
    given = {"references": problem.references, "disturbances": problem.disturbances}
    for k in range(4):
        found = controller.solve(problem.x if k == 0 else None, **given)
        assert found.status in (0, 1)
        for control in controller.problem.control_limits:
            low, high = (
                _number(controller, end) for end in (control.limits.minimum, control.limits.maximum)
            )
            assert np.all(found.controls[control.name] >= low)
            assert np.all(found.controls[control.name] <= high)
            if control.rate is not None:
                moved = np.diff(found.controls[control.name], axis=0)
                assert np.max(np.abs(moved)) <= control.rate * (1 + 1e-12)


def _number(controller: Controller, name: str | None) -> float:
    assert name is not None
    problem = controller.problem
    op = problem.program.step[problem.node(name)].op
    assert isinstance(op, Constant)
    return op.values[0]
