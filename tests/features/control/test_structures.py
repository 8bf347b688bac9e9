"""The window form of a plant, what a structure is estimated to cost, and its step in Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Sample, chosen_structure, estimate, window_form
from msnn.features.control.run.interior_point.newton_step import (
    HeldControls,
    condensed_step,
    newton_step,
)
from tests.features.control.specs import DELAYED, DOUBLE_INTEGRATOR, controller, load, mpc

FILTER = """
msnn: 1
name: filtered
sample_time: 0.1 s
inputs: {u: {between: hold}}
layers: {h: {fir: {window: 12, init: 0.05}}}
states: {x: {next: 0.9 * x + h(u), init: x.meas}}
outputs: {y: x}
mpc:
  horizon: 10
  controls: [u]
  cost: (x - 0.5)**2 + 0.01 * u**2
  bounds: {u: {min: -1, max: 1}}
"""


def test_what_a_window_has_of_others_is_no_state(tmp_path: Path) -> None:
    problem = load(tmp_path, DELAYED).of(ControlProblem)
    assert problem is not None
    form = window_form(problem)
    # y.tape has y[t-2] … y[t], u.history u[t-2] and u[t-1], d.history d[t-1]
    assert form.memory == (
        Sample(is_control=False, number=0, lag=2),
        Sample(is_control=False, number=0, lag=1),
        Sample(is_control=False, number=0, lag=0),
        Sample(is_control=True, number=0, lag=2),
        Sample(is_control=True, number=0, lag=1),
        Sample(is_control=False, number=1, lag=0),
    )
    assert form.newest == (2, 5)
    assert form.states == 2


def test_the_estimate_by_hand(tmp_path: Path) -> None:
    problem = load(tmp_path, FILTER).of(ControlProblem)
    assert problem is not None
    found = estimate(problem)
    # 10 stages of 12 numbers and a control; one state: 10²/2 + 10²/2 + 10³/6 + 10³/6
    assert found.staged == 10 * (12 * 13 * 25 + 12 * 13)
    assert found.condensed == 50 + 50 + 166 + 166
    assert chosen_structure(problem) == "condensed"
    few = load(tmp_path, DOUBLE_INTEGRATOR + mpc(horizon="40")).of(ControlProblem)
    assert few is not None
    assert chosen_structure(few) == "staged"


@pytest.mark.parametrize("blocks", [(), (2, 5)])
def test_its_step_is_that_of_the_recursion(blocks: tuple[int, ...]) -> None:
    """Of a quadratic problem with gaps, and with controls that are held at some stages."""
    n, nx, nu = 6, 4, 2
    random = np.random.default_rng(3)
    root = random.normal(size=(n + 1, nx + nu, nx + nu))
    hessian = root @ root.transpose(0, 2, 1) + np.eye(nx + nu)
    gradient = random.normal(size=(n + 1, nx + nu))
    hessian[n, nx:], hessian[n, :, nx:], gradient[n, nx:] = 0, 0, 0
    slopes, gaps = random.normal(size=(n, nx, nx + nu)), random.normal(size=(n, nx))
    stages = np.isin(np.arange(n), blocks)
    held = HeldControls(stages, np.eye(nu, nx))
    held_gaps = random.normal(size=(n, nu))
    own = condensed_step(hessian, gradient, slopes, gaps, held, held_gaps)
    other = newton_step(hessian, gradient, slopes, gaps, held, held_gaps)
    assert own is not None
    assert other is not None
    for a, b in zip(own, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("solver", ["c", "python"])
def test_the_spec_may_say_which(solver: str, tmp_path: Path) -> None:
    costs: list[float] = []
    for structure in ("staged", "condensed"):
        section = f"  solver: {{interior_point: {{structure: {structure}}}}}\n"
        own = controller(tmp_path, FILTER + section, solver)  # pyright: ignore[reportArgumentType]
        found = own.solve({"x": 0.2})
        assert found.status == 0
        assert own.residuals(found).largest <= 1.001e-6
        costs.append(found.cost)
    # each of 20 limits may leave its product of slack and multiplier, at most 1e-6, in the cost
    assert costs[0] == pytest.approx(costs[1], abs=20e-6)


TWO_CONTROLS = """
msnn: 1
name: two
sample_time: 0.1 s
inputs: {a: {between: hold}, b: {between: hold}}
states: {x: {next: 1.1 * x + 0.3 * a + 0.2 * b + 0.05 * x * a, init: x.meas}}
outputs: {y: x}
mpc:
  horizon: 9
  controls: [b, a]
  cost: (x - 1)**2 + 0.1 * a**2 + 0.02 * b**2
  bounds: {a: {min: -1, max: 1}, b: {min: -2, max: 2}}
"""


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize("structure", ["staged", "condensed"])
def test_controls_may_stand_in_another_order_than_inputs(
    structure: str, solver: str, tmp_path: Path
) -> None:
    """Derivatives have the order of the program, the plan that of `controls`."""
    section = f"  solver: {{interior_point: {{structure: {structure}}}}}\n"
    own = controller(tmp_path, TWO_CONTROLS + section, solver)  # pyright: ignore[reportArgumentType]
    found = own.solve({"x": 0.7})
    assert found.status == 0
    assert own.residuals(found).largest <= 1.001e-6
