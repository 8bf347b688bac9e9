"""Solutions that are known by other means, and the judge of all others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from msnn.features.control.problem.kkt import Judge
from tests.features.control.specs import DOUBLE_INTEGRATOR, controller, mpc

Array = NDArray[np.float64]
A = np.array([[1.0, 0.1], [0.0, 1.0]])
B = np.array([[0.0], [0.1]])


def riccati(value: Array) -> tuple[Array, Array]:
    """The value function a step earlier, and the gain of that step."""
    gain: Array = np.asarray(np.linalg.solve(0.1 + B.T @ value @ B, B.T @ value @ A), np.float64)
    return np.diag([4.0, 1.0]) + A.T @ value @ (A - B @ gain), gain


def test_linear_quadratic_control_is_the_riccati_recursion(tmp_path: Path) -> None:
    found = controller(tmp_path, DOUBLE_INTEGRATOR + mpc()).solve({"p": 1.0, "v": -0.5})
    value, gain = np.diag([20.0, 5.0]), np.zeros((1, 2))
    for _ in range(15):
        value, gain = riccati(value)
    x = np.array([1.0, -0.5])
    assert found.control["u"] == pytest.approx(-(gain @ x)[0], rel=1e-9)
    assert found.cost == pytest.approx(x @ value @ x, rel=1e-12)
    assert found.iterations <= 2


def test_the_penalty_is_exact(tmp_path: Path) -> None:
    """A soft bound holds where a hard one can, at the same plan, while the penalty is steep."""
    bounds = "{u: {min: -6, max: 6}, v: {min: -0.6, hard: true}}"
    hard = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds)).solve({"p": 1.0, "v": 0.0})
    soft = bounds.replace("hard: true", "soft: {linear: 50, quadratic: 1}")
    kept = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=soft)).solve({"p": 1.0, "v": 0.0})
    assert hard.multipliers is not None
    assert 1 < np.max(hard.multipliers.path_min[0]) < 50
    # both keep their limits up to the barrier that is left, 1e-7 over their multipliers
    np.testing.assert_allclose(kept.controls["u"], hard.controls["u"], atol=1e-4)
    weak = bounds.replace("hard: true", "soft: {linear: 1, quadratic: 0}")
    past = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=weak)).solve({"p": 1.0, "v": 0.0})
    assert past.excess > 0.01


def test_the_judge_sees_what_is_not_optimal(tmp_path: Path) -> None:
    bounds = "{u: {min: -2, max: 2, rate: 30}, v: {min: -0.6}}"
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds))
    found = own.solve({"p": 1.0, "v": 0.0})
    given, plan, multipliers = found.given, found.plan, found.multipliers
    assert given is not None
    assert plan is not None
    assert multipliers is not None
    judge = Judge(own.problem)
    assert judge.residuals(given, plan, multipliers).largest <= 1.001e-6
    moved = replace(plan, controls=plan.controls + 1e-3)
    told = judge.residuals(given, moved, multipliers)
    assert told.dynamics > 1e-5
    assert told.stationarity > 1e-5
    beyond = replace(plan, controls=plan.controls - 5)
    assert judge.residuals(given, beyond, multipliers).bounds > 1
    negative = replace(multipliers, control_max=multipliers.control_max - 1e-3)
    assert judge.residuals(given, plan, negative).complementarity >= 1e-3
    steep = replace(multipliers, path_min=tuple(z + 1e6 for z in multipliers.path_min))
    assert judge.residuals(given, plan, steep).largest > 1
    lost = replace(plan, states=np.where(plan.states > 0.9, np.nan, plan.states))
    assert not judge.residuals(given, lost, multipliers).largest <= 1e30


def test_no_wrong_solved_among_random_problems(tmp_path: Path) -> None:
    """Infeasible, stiff, unstable, with equal bounds and zero weights: `solved` is always so."""
    random = np.random.default_rng(1)
    counts = dict.fromkeys(range(5), 0)
    for _ in range(10):  # what takes long is to compile a controller; each has five starts
        a, b, c, d = random.normal(0, 1.2, 4)
        low, high = np.sort(random.choice([-1.0, -0.2, 0.0, 0.3, 1.0], 2))
        plant = f"""
msnn: 1
name: drawn
sample_time: 0.1 s
inputs: {{u: {{}}}}
states:
  x: {{next: {a} * x + {b} * tanh(y) + u, init: x.meas}}
  y: {{next: {c} * sin(x) + {d} * y, init: y.meas}}
outputs: {{z: x * y}}
"""
        weights = random.choice([0.0, 1e-3, 1.0, 50.0], 3)
        hard = random.choice(["", ", hard: true"])
        cost = (
            f"{weights[0]} * x**2 + {weights[1]} * z**2 + {weights[2]} * u**2 + 1e-4 * (u - x)**2"
        )
        section = mpc(
            horizon=str(random.integers(1, 12)),
            cost=cost,
            bounds=f"{{u: {{min: {low}, max: {high}}}, y: {{max: 0.5{hard}}}}}",
        )
        own = controller(tmp_path, plant + section)
        for x, y in random.normal(0, 1.5, (5, 2)):
            own.reset()
            found = own.solve({"x": x, "y": y})
            counts[int(found.status)] += 1
            assert low <= found.control["u"] <= high
            if found.status == 0:
                assert own.residuals(found).largest <= 1.01e-6
    assert counts[0] >= 24
    assert counts[0] + counts[2] >= 44  # the rest ran out of iterations, and says so
    assert counts[3] == counts[4] == 0
