"""The judge of plans against a Lagrangian written out by hand: each condition is seen alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.features.control.problem.horizon import Given, Multipliers, Plan
from msnn.features.control.problem.kkt import Judge, Residuals
from msnn.features.control.problem.optimal_control import ControlProblem
from tests.features.control.specs import load

TEXT = """
msnn: 1
name: two_samples
sample_time: 1 s
inputs: {u: {between: hold}}
states: {x: {next: x + u, init: x.meas}}
outputs: {drive: x + 2 * u}
mpc:
  horizon: 2
  controls: [u]
  references: {top: {preview: true}}
  cost: {stage: x**2 + 0.5 * u**2, terminal: 3 * x**2}
  bounds:
    u: {min: -1, max: top, rate: 10}
    x: {min: -4, max: 4, hard: true}
    drive: {min: -3, max: 3, soft: {linear: 2, quadratic: 0.5}}
"""
LIMITED = {"control": (-1.0, 3.0), "rate": (-10.0, 10.0)}
PATHS = ((-4.0, 4.0), (-3.0, 3.0))
"""Of x at samples 1 and 2, of drive at 0 and 1."""


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    return _judge_of(tmp_path_factory.mktemp("judge"), TEXT)


def _judge_of(folder: Path, text: str) -> Judge:
    problem = load(folder, text).of(ControlProblem)
    assert problem is not None
    assert [path.name for path in problem.path_limits] == ["x", "drive"]
    assert [member.name for member in problem.states.members] == ["x", "u.history"]
    # a typical change is half of what bounds leave; those of u move with `top`
    assert [path.scale for path in problem.path_limits] == [4.0, 3.0]
    assert problem.control_limits[0].scale == 1.0
    return Judge(problem)


def nothing() -> Multipliers:
    none, of_path = np.zeros((2, 1)), (np.zeros((2, 1)), np.zeros((2, 1)))
    return Multipliers(none, none, none, none, of_path, of_path)


def with_one(name: str, at: int, value: float) -> Multipliers:
    """Nothing but one multiplier; `name` is a field, a path's with its number."""
    field, _, number = name.partition(" ")
    own = np.zeros((2, 1))
    own[at] = value
    if not number:
        return replace(nothing(), **{field: own})
    found = [own if i == int(number) else np.zeros((2, 1)) for i in range(2)]
    changed: dict[str, Any] = {field: tuple(found)}
    return replace(nothing(), **changed)


def judged(
    judge: Judge,
    x: float,
    controls: tuple[float, float],
    multipliers: Multipliers,
    before: float = 0.0,
    top: tuple[float, float, float] = (3.0, 3.0, 3.0),
) -> Residuals:
    """Of the plan that these controls make of the plant."""
    u0, u1 = controls
    states = np.array([[x, before], [x + u0, u0], [x + u0 + u1, u1]])
    given = Given(states[0].copy(), {}, {"top": np.array(top)})
    return judge.residuals(given, Plan(states, np.array([[u0], [u1]])), multipliers)


def distances(x: float, u: FloatArray, before: float) -> dict[str, FloatArray]:
    """Of every limit, named as its multiplier."""
    states = np.array([x, x + u[0], x + u[0] + u[1]])
    moved = np.array([u[0] - before, u[1] - u[0]])
    values = {
        "control": u,
        "rate": moved,
        "path 0": states[1:],
        "path 1": states[:2] + 2 * u,
    }
    limits = LIMITED | {f"path {i}": ends for i, ends in enumerate(PATHS)}
    found: dict[str, FloatArray] = {}
    for name, value in values.items():
        kind, _, number = name.partition(" ")
        low, high = limits[name]
        found[f"{kind}_min {number}".strip()] = value - low
        found[f"{kind}_max {number}".strip()] = high - value
    return found


NAMES = tuple(distances(0.0, np.zeros(2), 0.0))


def cost(x: float, u: FloatArray) -> float:
    x1, x2 = x + u[0], x + u[0] + u[1]
    return float(x**2 + x1**2 + 0.5 * (u @ u) + 3 * x2**2)


def steepest(x: float, u: FloatArray, before: float, name: str, at: int, z: float) -> FloatArray:
    """∂/∂u of J − z · distance; both are quadratic at most: differences are exact."""
    found: list[float] = []
    for step in np.eye(2):
        ends = [
            cost(x, moved) - z * distances(x, moved, before)[name][at]
            for moved in (u - step, u + step)
        ]
        found.append((ends[1] - ends[0]) / 2)
    return np.array(found)


@pytest.mark.parametrize("at", [0, 1])
@pytest.mark.parametrize("name", NAMES)
def test_each_multiplier_pulls_as_its_limit_does(judge: Judge, name: str, at: int) -> None:
    x, u, before, z = 0.4, np.array([0.5, -0.25]), 0.2, 1.75
    found = judged(judge, x, (0.5, -0.25), with_one(name, at, z), before)
    slope = np.max(np.abs(steepest(x, u, before, name, at, z)))
    assert found.stationarity == pytest.approx(slope, rel=1e-12)
    assert found.dynamics == 0
    assert found.bounds == 0
    far = distances(x, u, before)[name][at]
    # a multiplier of a limit that is not reached; 1.75 is less than the soft limit's 2
    assert found.complementarity == pytest.approx(far * z, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "at", "x", "controls", "before"),
    [
        ("control_min", 0, 0.0, (-1.0, 0.0), 0.0),
        ("control_max", 1, -3.0, (0.0, 3.0), 0.0),
        ("rate_min", 0, 0.0, (0.0, 0.0), 10.0),
        ("rate_max", 0, 0.0, (0.0, 0.0), -10.0),
        ("path_min 0", 0, -5.0, (1.0, 0.5), 0.0),
        ("path_max 0", 1, 7.0, (-2.0, -1.0), 0.0),
        ("path_min 1", 0, -1.0, (-1.0, 0.0), 0.0),
        ("path_max 1", 1, 0.0, (0.0, 1.5), 0.0),
    ],
)
def test_a_multiplier_at_its_limit_is_at_least_zero(
    judge: Judge, name: str, at: int, x: float, controls: tuple[float, float], before: float
) -> None:
    """There its product with the distance is 0 whatever it is: one below 0 is seen by its size."""
    assert distances(x, np.array(controls), before)[name][at] == 0
    above = judged(judge, x, controls, with_one(name, at, 1.5), before)
    assert above.complementarity == 0
    below = judged(judge, x, controls, with_one(name, at, -1e-3), before)
    scale = {"0": 4.0, "1": 3.0}.get(name[-1], 1.0)
    assert below.complementarity == pytest.approx(1e-3 * scale, rel=1e-12)


@pytest.mark.parametrize(
    ("x", "controls", "before", "beyond"),
    [
        (0.0, (0.5, -0.25), 0.2, 0.0),
        (-1.0, (3.5, -0.5), 0.0, 0.5),
        (-1.0, (0.5, 3.25), 0.0, 0.25),
        (0.0, (-1.5, 0.0), 0.0, 0.5),
        (0.0, (0.0, -1.125), 0.0, 0.125),
        (0.0, (0.5, 0.0), -12.0, 2.5),
        (0.0, (0.5, 0.0), 12.0, 1.5),
        (3.5, (1.0, -1.0), 0.0, 0.5 / 4),
        (3.0, (0.5, 1.0), 0.0, 0.5 / 4),
        (-4.0, (-0.75, 1.0), 0.0, 0.75 / 4),
        (-3.0, (-0.5, -0.8), 0.0, 0.3 / 4),
        (5.0, (-1.0, -1.0), 0.0, 0.0),  # x is measured now: nothing limits it
    ],
)
def test_each_limit_is_kept(
    judge: Judge, x: float, controls: tuple[float, float], before: float, beyond: float
) -> None:
    """By u at either end and at either sample, by its move, by x at 1 and 2 and not at 0."""
    found = judged(judge, x, controls, nothing(), before)
    assert found.bounds == pytest.approx(beyond, rel=1e-12)
    assert found.dynamics == 0


def test_limits_are_those_of_their_own_samples(judge: Judge) -> None:
    for top, beyond in (((0.5, 3, 3), 0.0), ((0.25, 3, 3), 0.25), ((3, 0.5, 0), 0.5)):
        found = judged(judge, 0.0, (0.5, 1.0), nothing(), top=top)
        assert found.bounds == beyond


@pytest.mark.parametrize(
    ("x", "controls", "name", "at", "v"),
    [
        (2.5, (0.5, -0.5), "path_max 1", 0, 0.5),
        (1.75, (0.5, 0.75), "path_max 1", 1, 0.75),
        (-1.5, (-1.0, 0.5), "path_min 1", 0, 0.5),
        (-1.0, (-0.75, -1.0), "path_min 1", 1, 0.75),
    ],
)
def test_a_soft_limit_that_is_exceeded_has_the_multiplier_of_its_cost(
    judge: Judge, x: float, controls: tuple[float, float], name: str, at: int, v: float
) -> None:
    """w₁ + 2 w₂ v with w₁ = 2 and w₂ = 0.5; what is beyond breaks nothing."""
    for z, product in ((2 + v, 0.0), (0.0, (2 + v) * v), (1.5 + v, 0.5 * v)):
        found = judged(judge, x, controls, with_one(name, at, z))
        assert found.bounds == 0
        assert found.complementarity == pytest.approx(product, abs=1e-12)
    # more than any cost asks for; 3 is the scale
    found = judged(judge, x, controls, with_one(name, at, 2 + v + 1e-3))
    assert found.complementarity == pytest.approx(3e-3, rel=1e-9)


def test_a_plan_begins_at_what_was_measured(judge: Judge) -> None:
    states = np.array([[0.0, 0.0], [0.5, 0.5], [0.25, -0.25]])
    plan = Plan(states, np.array([[0.5], [-0.25]]))
    top = {"top": np.full(3, 3.0)}
    # 4 is the scale of x
    for measured, gap in (([0.0, 0.0], 0.0), ([0.5, 0.0], 0.5 / 4), ([0.0, -0.5], 0.5)):
        found = judge.residuals(Given(np.array(measured), {}, top), plan, nothing())
        assert found.dynamics == gap
    for row, column in ((1, 0), (2, 0), (1, 1), (2, 1)):
        moved = states.copy()
        moved[row, column] += 0.5
        found = judge.residuals(Given(states[0], {}, top), replace(plan, states=moved), nothing())
        assert found.dynamics >= 0.5 / 4


def test_what_is_no_number_is_never_optimal(judge: Judge) -> None:
    for top in ((np.nan, 3, 3), (3, np.nan, 3)):
        assert np.isnan(judged(judge, 0.0, (0.5, -0.25), nothing(), top=top).largest)
    assert np.isnan(judged(judge, np.nan, (0.5, -0.25), nothing()).largest)
    assert np.isnan(judged(judge, 0.0, (0.5, -0.25), with_one("rate_min", 1, np.nan)).largest)


def test_a_multiplier_of_no_limit_is_seen(judge: Judge) -> None:
    free = (np.inf, 3.0, 3.0)
    found = judged(judge, 0.0, (0.5, -0.25), with_one("control_max", 0, 0.125), top=free)
    assert found.complementarity == 0.125


def test_a_block_has_one_control(tmp_path: Path) -> None:
    judge = _judge_of(tmp_path, TEXT + "  blocks: [2]\n")
    x, u = 0.4, np.array([0.5, 0.5])
    found = judged(judge, x, (0.5, 0.5), nothing())
    whole = np.sum(steepest(x, u, 0.0, "control_min", 0, 0.0))
    assert found.stationarity == pytest.approx(whole, rel=1e-12)
    assert found.bounds == 0
    assert judged(judge, x, (0.5, 0.625), nothing()).bounds == 0.125
