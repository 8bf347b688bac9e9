"""What a controller takes from one sample to the next, and how far controls may move, by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Solver, Status
from tests.conditions import require_tool
from tests.features.control.specs import DOUBLE_INTEGRATOR, controller, load, mpc

DISTURBED = """
msnn: 1
name: disturbed
sample_time: 1 s
inputs: {u: {between: hold}, d: {between: hold}, w: {between: hold}}
states: {x: {next: 0.9 * x + 0.2 * u + 0.1 * d + 10 * w, init: x.meas}}
outputs: {y: x}
mpc:
  horizon: 3
  controls: [u]
  cost: x**2 + u**2
  preview: [d]
"""

CHAIN = """
msnn: 1
name: chain
sample_time: 0.1 s
inputs: {u: {between: hold}}
states:
  p: {next: p + 0.1 * v, init: p.meas}
  v: {next: v + 0.1 * a, init: v.meas}
  a: {next: a + 0.1 * u, init: a.meas}
outputs: {place: p}
mpc:
  horizon: 30
  controls: [u]
  cost: {stage: p**2 + 0.1 * v**2 + 0.01 * u**2, terminal: 10 * p**2 + 5 * v**2 + a**2}
  bounds: {u: {min: -3, max: 3}, a: {min: -1, max: 1}}
  solver: {interior_point: SOLVER}
"""


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize("mode", ["fixed", "converged"])
@pytest.mark.parametrize(
    ("structure", "iterations", "capped"), [("staged", 4, 7), ("condensed", 6, 1)]
)
def test_a_capped_plan_is_gone_on_with(
    structure: str, iterations: int, capped: int, mode: str, solver: Solver, tmp_path: Path
) -> None:
    """With its multipliers, in both solvers: no number of new starts of so few iterations ends."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    keys = f"{{mode: {mode}, iterations: {iterations}, structure: {structure}}}"
    own = controller(tmp_path, CHAIN.replace("SOLVER", keys), solver)
    p, v, a = 0.6, 0.3, 0.0
    statuses: list[Status] = []
    for t in range(12):
        found = own.solve({"p": p, "v": v, "a": a})
        statuses.append(found.status)
        if found.status is Status.CAPPED:
            # the second start counts, whichever of both plans is applied
            starts = 2 if mode == "converged" and t else 1
            assert found.iterations == starts * iterations
        p, v, a = p + 0.1 * v, v + 0.1 * a, a + 0.1 * float(found.control["u"])
    assert statuses == [Status.CAPPED] * capped + [Status.SOLVED] * (12 - capped)


@pytest.mark.parametrize("solver", ["c", "python"])
def test_what_is_not_measured_is_predicted_with_what_acted(solver: Solver, tmp_path: Path) -> None:
    """By the first sample of a preview, that of the time at which the control is applied."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    own = controller(tmp_path, DISTURBED, solver)
    x = 2.0
    for t in range(4):
        d, w = np.array([1.0, -3.0, 7.0]) + t, 0.25 * t
        found = own.solve({"x": x} if t == 0 else None, disturbances={"d": d, "w": w})
        assert found.given is not None
        assert found.given.state == pytest.approx([x], rel=1e-14)
        assert found.states["x"][1] == pytest.approx(
            0.9 * x + 0.2 * found.control["u"] + 0.1 * d[0] + 10 * w, abs=1e-5
        )
        x = 0.9 * x + 0.2 * float(found.control["u"]) + 0.1 * (1.0 + t) + 10 * w


@pytest.mark.parametrize(
    ("bounds", "before", "wanted", "allowed"),
    [
        # 5/s are 0.5 a sample of 0.1 s
        ("{u: {min: -6, max: 6, rate: 5}}", 2.0, 9.0, [2.5, 3.0, 3.5, 4.0]),
        ("{u: {min: -6, max: 6, rate: 5}}", -2.0, -9.0, [-2.5, -3.0, -3.5, -4.0]),
        ("{u: {min: -6, max: 3.2, rate: 5}}", 2.0, 9.0, [2.5, 3.0, 3.2, 3.2]),
        ("{u: {min: -6, max: 6, rate: 5}}", 2.0, 2.25, [2.25, 2.25, 2.25, 2.25]),
    ],
)
def test_controls_move_by_their_rate_from_what_was_applied(
    bounds: str, before: float, wanted: float, allowed: list[float], tmp_path: Path
) -> None:
    problem = load(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds, horizon="4")).of(ControlProblem)
    assert problem is not None
    functions = HorizonFunctions(problem)
    assert [member.name for member in problem.states.members] == ["p", "v", "u.history"]
    state = np.array([0.0, 0.0, before])
    reach = ControlRange(functions, functions.limits(Given(state, {}, {})), state)
    scale = functions.scale_u
    found = reach.nearest(np.full((4, 1), wanted) / scale) * scale
    assert found[:, 0] == pytest.approx(allowed, rel=1e-12)
    assert reach.first(np.array([wanted]) / scale) * scale == pytest.approx(allowed[:1], rel=1e-12)


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize("structure", ["staged", "condensed"])
def test_controls_of_capped_plans_move_by_their_rate(
    structure: str, solver: Solver, tmp_path: Path
) -> None:
    """Also in `found.control`, which generated C cuts back; and a cut plan is not infeasible."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    keys = f"{{interior_point: {{mode: fixed, iterations: 3, structure: {structure}}}}}"
    bounds = "{u: {min: -2, max: 2, rate: 5}}"
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds, solver=keys), solver)
    before = 0.0
    statuses: set[Status] = set()
    for t in range(10):
        found = own.solve({"p": (-1.0) ** t, "v": 0.1 * t})
        statuses.add(found.status)
        along = np.concatenate([[before], found.controls["u"].ravel()])
        assert np.abs(np.diff(along)).max() <= 0.5 + 1e-9
        assert found.violation <= 1e-9
        before = float(found.control["u"])
        assert before == found.controls["u"].ravel()[0]
    assert statuses <= {Status.SOLVED, Status.CAPPED}
    assert Status.CAPPED in statuses
