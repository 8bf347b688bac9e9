"""Plans and estimates beside the same problems, written by hand for ipopt: nothing is shared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import msnn
from msnn.features.control.run.method import Solver, Status
from tests.conditions import require_tool
from tests.features.control.specs import controller, load

TANK = """
msnn: 1
name: tank
sample_time: 4 s
inputs: {pump: {range: [0, 10], between: hold}, leak: {range: [-0.1, 0.1], between: hold}}
states:
  level:
    der: 0.04 * pump - 0.08 * sqrt(max(level, 0.1)) - leak
    init: level.meas
    range: [0, 40]
integrator: rk4
equations: {flow: 0.5 * pump + 0.1 * level}
outputs: {level_next: {expr: next(level), predicts: "level[t+1]"}}
mpc:
  horizon: 20
  controls: [pump]
  references: {wanted: {preview: true}, top: {preview: true}}
  preview: [leak]
  blocks: BLOCKS
  cost:
    stage: (level - wanted)**2 + 0.05 * (pump - pump[t-1])**2
    terminal: 10 * (level - wanted)**2
  bounds:
    pump: {min: 0, max: 10, rate: 0.5}
    level: {max: top, soft: {linear: 30, quadratic: 20}}
    flow: {max: 4.5, soft: {linear: 5, quadratic: 1}}
  solver: {interior_point: {structure: STRUCTURE}}
estimator:
  mhe: {horizon: 40 s, measured: {level_next: 0.2}, process: {level: 0.05}, initial: {level: 1}}
"""
N = 20
BLOCKS = {"free": [1] * N, "blocks": [1, 1, 2, 4, 12]}
QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-10}


def stepped(level: Any, pump: Any, leak: Any) -> Any:
    """One sample of 4 s by Runge and Kutta."""

    def der(x: Any) -> Any:
        return 0.04 * pump - 0.08 * casadi.sqrt(casadi.fmax(x, 0.1)) - leak

    k1 = der(level)
    k2 = der(level + 2 * k1)
    k3 = der(level + 2 * k2)
    return level + 4 / 6 * (k1 + 2 * k2 + 2 * k3 + der(level + 4 * k3))


def planned(
    level: float, before: float, wanted: Any, top: Any, leak: Any, blocks: list[int]
) -> tuple[float, Any]:
    """J and the pump along the horizon."""
    nlp = casadi.Opti()
    x, block = nlp.variable(N + 1), nlp.variable(len(blocks))
    u = [block[number] for number, size in enumerate(blocks) for _ in range(size)]
    nlp.subject_to(x[0] == level)
    cost, last = 10 * (x[N] - wanted[N]) ** 2, before
    excess = nlp.variable(2, N)
    begins = {0, *np.cumsum(blocks)[:-1].tolist()}
    nlp.subject_to(casadi.vec(excess) >= 0)
    for k in range(N):
        nlp.subject_to(x[k + 1] == stepped(x[k], u[k], leak[k]))
        nlp.subject_to(nlp.bounded(0, u[k], 10))
        if k in begins:
            nlp.subject_to(nlp.bounded(-2, u[k] - last, 2))
        nlp.subject_to(x[k + 1] - top[k + 1] <= excess[0, k])
        nlp.subject_to(0.5 * u[k] + 0.1 * x[k] - 4.5 <= excess[1, k])
        cost += (x[k] - wanted[k]) ** 2 + 0.05 * (u[k] - last) ** 2
        cost += 30 * excess[0, k] + 20 * excess[0, k] ** 2 + 5 * excess[1, k] + excess[1, k] ** 2
        last = u[k]
    nlp.minimize(cost)
    nlp.solver("ipopt", QUIET)
    nlp.set_initial(x, level)
    solved = nlp.solve()
    return float(solved.value(cost)), np.array(solved.value(casadi.vertcat(*u)))


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("blocks", BLOCKS)
def test_plans_are_those_of_a_problem_by_hand(
    blocks: str, structure: str, solver: Solver, tmp_path: Path
) -> None:
    """Previews of references, of a limit and of a disturbance, a rate, and a limit of controls."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    text = TANK.replace("STRUCTURE", structure).replace("BLOCKS", str(BLOCKS[blocks]))
    own = controller(tmp_path, text, solver)
    own.reset(control={"pump": 0.0})
    level, before, exceeded = 4.0, 0.0, False
    for t in range(7):
        time = t + np.arange(N + 1)
        wanted, top = np.where(time < 8, 9.0, 5.0), np.where(time < 5, 12.0, 7.0)
        leak = 0.05 * np.sin(0.4 * time[:N])
        found = own.solve(
            {"level": level},
            references={"wanted": wanted, "top": top},
            disturbances={"leak": leak},
        )
        cost, pump = planned(level, before, wanted, top, leak, BLOCKS[blocks])
        assert found.status is Status.SOLVED
        # the tolerance is 1e-6 in scaled numbers, that of the pump is 5 V
        assert found.cost == pytest.approx(cost, rel=1e-5)
        assert found.controls["pump"].ravel() == pytest.approx(pump, abs=2e-3)
        exceeded |= found.excess > 1e-3
        before = float(found.control["pump"])
        level = float(stepped(level, before, leak[0])) + 0.05 * (-1) ** t
    assert exceeded


def test_estimates_of_windows_are_those_of_a_problem_by_hand(tmp_path: Path) -> None:
    """A window that grows has all that was measured, so that no arrival cost comes in."""
    text = TANK.replace("STRUCTURE", "auto").replace("BLOCKS", str(BLOCKS["free"]))
    estimator = msnn.estimator(load(tmp_path, text))
    estimator.reset({"level": 4.0})
    random = np.random.default_rng(8)
    level, measured, inputs = 6.0, list[float](), list[tuple[float, float]]()
    for _ in range(8):
        measured.append(level + 0.2 * random.normal())
        found = estimator.correct({"level": measured[-1]})
        nlp = casadi.Opti()
        x, noise = nlp.variable(len(measured)), nlp.variable(len(measured))
        cost = (x[0] - 4) ** 2 + casadi.sumsqr(noise)
        for k, value in enumerate(measured):
            cost += ((value - x[k]) / 0.2) ** 2
        for k, (pump, leak) in enumerate(inputs):
            # the standard deviation grows with the root of 4 s
            nlp.subject_to(x[k + 1] == stepped(x[k], pump, leak) + 0.05 * 2 * noise[k])
        nlp.minimize(cost)
        nlp.solver("ipopt", QUIET)
        nlp.set_initial(x, np.array(measured))
        last = np.atleast_1d(nlp.solve().value(x))[-1]
        assert found.states["level"] == pytest.approx(last, abs=1e-6)
        pump, leak = float(random.uniform(0, 8)), float(random.uniform(-0.05, 0.05))
        inputs.append((pump, leak))
        estimator.predict({"pump": pump, "leak": leak})
        level = float(stepped(level, pump, leak)) + 0.1 * random.normal()


JOINTS = """
msnn: 1
name: joints
sample_time: 0.1 s
dims: {joint: 2}
inputs: {u: {dims: joint, between: hold}, wind: {dims: joint, between: linear}}
states:
  p: {dims: joint, der: v, init: p.meas}
  v: {dims: joint, der: u - 0.3 * sin(p) + 0.1 * wind, init: v.meas}
integrator: rk4
outputs: {place: 1 * p}
mpc:
  horizon: 8
  controls: [u]
  preview: [wind]
  cost: {stage: sum(p**2 + 0.1 * v**2 + 0.05 * u**2), terminal: 5 * sum(p**2)}
  bounds: {u: {min: -2, max: 2, rate: 10}}
  solver: {interior_point: {structure: STRUCTURE}}
"""


def planned_joints(state: Any, before: Any, wind: Any) -> tuple[float, Any]:
    """J and the controls, (8, 2), of the wind at 9 samples."""
    nlp = casadi.Opti()
    x, u, cost = nlp.variable(4, 9), nlp.variable(2, 8), 0.0
    nlp.subject_to(x[:, 0] == state)
    for k in range(8):

        def der(x: Any, part: float, k: int = k) -> Any:
            blown = wind[k] + part * (wind[k + 1] - wind[k])
            return casadi.vertcat(x[2:], u[:, k] - 0.3 * casadi.sin(x[:2]) + 0.1 * blown)

        k1 = der(x[:, k], 0.0)
        k2 = der(x[:, k] + 0.05 * k1, 0.5)
        k3 = der(x[:, k] + 0.05 * k2, 0.5)
        k4 = der(x[:, k] + 0.1 * k3, 1.0)
        nlp.subject_to(x[:, k + 1] == x[:, k] + 0.1 / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        nlp.subject_to(nlp.bounded(-2, u[:, k], 2))
        nlp.subject_to(nlp.bounded(-1, u[:, k] - (u[:, k - 1] if k else before), 1))
        cost += casadi.sumsqr(x[:2, k]) + 0.1 * casadi.sumsqr(x[2:, k])
        cost += 0.05 * casadi.sumsqr(u[:, k])
    nlp.minimize(cost + 5 * casadi.sumsqr(x[:2, 8]))
    nlp.solver("ipopt", QUIET)
    solved = nlp.solve()
    return float(solved.value(nlp.f)), np.array(solved.value(u)).T


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize("structure", ["staged", "condensed"])
def test_vectors_of_controls_and_a_preview_on_straight_lines(
    structure: str, solver: Solver, tmp_path: Path
) -> None:
    """What is read of the sample after the preview is its last value."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    own = controller(tmp_path, JOINTS.replace("STRUCTURE", structure), solver)
    before = np.zeros(2)
    own.reset(control={"u": before})
    p, v = np.array([1.0, -0.5]), np.array([0.2, 0.0])
    for t in range(3):
        time = np.minimum(t + np.arange(9), t + 7)
        wind = np.stack([np.sin(0.3 * time), np.cos(0.5 * time)], axis=1)
        found = own.solve({"p": p, "v": v}, disturbances={"wind": wind[:8]})
        cost, controls = planned_joints(np.concatenate([p, v]), before, wind)
        assert found.status is Status.SOLVED
        assert found.cost == pytest.approx(cost, rel=1e-6)
        np.testing.assert_allclose(found.controls["u"], controls, atol=1e-4)
        before = np.array(found.control["u"])
        p, v = np.array(found.states["p"][1]), np.array(found.states["v"][1])
