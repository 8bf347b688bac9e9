"""Limits and references that come with a sample: each control that is returned goes by its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.features.control.backend import write_controller
from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.problem.optimal_control import ControlProblem
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.specs import load

SOLVED, CAPPED = range(2)
STRUCTURES = ("condensed", "staged")
PLANT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {{u: {{between: hold}}, d: {{between: hold}}}}
states: {{x: {{next: 0.9 * x + 0.2 * u + 0.1 * d, init: 0}}}}
outputs: {{y: x}}
mpc:
  horizon: 8
  controls: [u]
  cost: {{stage: (x - r)**2 + 0.1 * (u - w)**2, terminal: 5 * (x - r)**2}}
  references: {{r: {{preview: true}}, w: {{}}, top: {{}}}}
  preview: [d]
  bounds: {{{bounds}}}
  solver: {{interior_point: {{structure: {structure}}}}}
"""
ROWS = 9
"""Samples of a preview: eight, and the end of the horizon."""


def built(folder: Path, structure: str, bounds: str, plant: str = PLANT) -> ControllerLibrary:
    require_tool("gcc", install="apt install gcc")
    problem = load(folder, plant.format(structure=structure, bounds=bounds)).of(ControlProblem)
    assert problem is not None
    out = folder / "c"
    write_controller(problem, {}, out, prefix="plant", dtype="float64")
    return built_controller(out)


def sample(x: float = 0.0, r: float = 1.0, top: float = 4.0) -> dict[str, float | FloatArray]:
    return {"x": x, "r": np.full(ROWS, r), "d": np.zeros(ROWS - 1), "w": 0.0, "top": top}


@pytest.mark.parametrize("structure", STRUCTURES)
def test_what_feedback_returns_keeps_the_limits_of_now(structure: str, tmp_path: Path) -> None:
    """It kept those of the sample before: 0.93 where 0.3 was the most."""
    own = built(tmp_path, structure, "u: {min: top - 5, max: top}")
    for x, r, before, now, expected in ((0.2, 1.0, 1.0, 0.3, 0.3), (-0.2, -2.0, 2.0, 4.6, -0.4)):
        own.init()
        assert own.solve(sample(0.0, r, before)).status == SOLVED
        own.prepare()
        found = own.feedback(sample(x, r, now))
        assert found.status == CAPPED
        assert found.control == [pytest.approx(expected, abs=1e-15)]
        # the step that was left is finished in limits that it was found in
        own.prepare()
        assert own.solve(sample(x, r, now)).control == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_feedback_sees_what_comes_at_its_own_time(structure: str, tmp_path: Path) -> None:
    """Far from limits a step is all: least squares of the horizon; it was a sample late."""
    own = built(tmp_path, structure, "u: {min: -top, max: top}")
    r, d = np.where(np.arange(40) < 5, 0.0, 0.7), np.where(np.arange(40) < 3, 0.4, -0.3)
    x = 0.25
    for t in range(12):
        now = {"x": x, "r": r[t : t + ROWS], "d": d[t : t + ROWS - 1], "w": 0.2, "top": 1e3}
        own.prepare()
        # the first one, which has no plan to go on from, solves
        u = float(own.feedback(now).control[0])
        assert u == pytest.approx(least_squares(x, r[t:], d[t:], 0.2), abs=1e-5)
        x = 0.9 * x + 0.2 * u + 0.1 * d[t]


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("calls", ["prepare", "feedback", "prepare feedback prepare"])
def test_a_solve_after_other_calls_is_of_what_is_known_now(
    structure: str, calls: str, tmp_path: Path
) -> None:
    """What was computed for a sample before would make an old plan look optimal."""
    bent = PLANT.replace("(x - r)**2 + 0.1", "(x - r)**2 * (1 + 0.1 * x**2) + 0.1")
    own = built(tmp_path, structure, "u: {min: -top, max: top}", bent)
    now = sample(0.0, r=0.7, top=1e3)
    expected = own.solve(now)
    assert expected.control[0] > 0.3
    own.init()
    # x stays where the plan has it, so that r alone is new
    assert own.solve(sample(0.0, r=0.0, top=1e3)).control == [pytest.approx(0, abs=1e-9)]
    for call in calls.split():
        if call == "prepare":
            own.prepare()
        else:
            assert own.feedback(now).status == CAPPED
    found = own.solve(now)
    assert found.status == SOLVED
    assert found.control == [pytest.approx(expected.control[0], abs=1e-5)]


def least_squares(x: float, r: FloatArray, d: FloatArray, w: float) -> float:
    """The first of eight controls, of the states written out in them."""
    n = ROWS - 1
    powers = 0.9 ** np.arange(n + 1)
    free = powers * x
    by_u = np.zeros((n + 1, n))
    for k in range(1, n + 1):
        for j in range(k):
            by_u[k, j] = 0.2 * powers[k - 1 - j]
            free[k] += 0.1 * powers[k - 1 - j] * d[j]
    weights = np.sqrt(np.append(np.ones(n), 5.0))
    rows = np.vstack([weights[:, None] * by_u, np.sqrt(0.1) * np.eye(n)])
    wanted = np.concatenate([weights * (r[: n + 1] - free), np.full(n, np.sqrt(0.1) * w)])
    return float(np.linalg.lstsq(rows, wanted, rcond=None)[0][0])
