"""A solve that follows prepare or feedback: it begins at their plan, one sample later, as of now.

Without limits the optimum of a linear plant is one step away, and what an optimal plan has left to
do is optimal: iterations tell where a solve began.
"""

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
HORIZON = 30
"""So long that what is behind its end is less than the tolerance."""
PLANT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {{u: {{between: hold}}, d: {{between: hold}}}}
states: {{x: {{next: 0.5 * x + u + d, init: 0}}}}
outputs: {{y: x}}
mpc:
  horizon: 30
  controls: [u]
  cost: {{stage: x**2 + 0.5 * u**2, terminal: x**2}}
  preview: [d]
  solver: {{interior_point: {{structure: {structure}}}}}
"""


@pytest.fixture(params=["staged", "condensed"])
def own(request: pytest.FixtureRequest, tmp_path: Path) -> ControllerLibrary:
    require_tool("gcc", install="apt install gcc")
    problem = load(tmp_path, PLANT.format(structure=request.param)).of(ControlProblem)
    assert problem is not None
    out = tmp_path / "c"
    write_controller(problem, {}, out, prefix="plant", dtype="float64")
    return built_controller(out)


def sample(x: float, d: float = 0.0) -> dict[str, float | FloatArray]:
    return {"x": x, "d": np.full(HORIZON, d)}


def after(x: float, control: FloatArray) -> float:
    return 0.5 * x + float(control[0])


def test_the_plan_of_a_feedback_is_a_sample_older(own: ControllerLibrary) -> None:
    x = 1.0
    first = own.solve(sample(x))
    assert (first.status, first.iterations) == (SOLVED, 1)
    x = after(x, first.control)
    own.prepare()
    second = own.feedback(sample(x))
    assert second.status == CAPPED
    x = after(x, second.control)
    third = own.solve(sample(x))
    assert (third.status, third.iterations) == (SOLVED, 0)


def test_the_plan_that_was_prepared_is_of_now(own: ControllerLibrary) -> None:
    x = 1.0
    x = after(x, own.solve(sample(x)).control)
    own.prepare()
    found = own.solve(sample(x))
    assert (found.status, found.iterations) == (SOLVED, 0)


def test_what_the_plan_does_is_computed_with_what_feedback_was_told(own: ControllerLibrary) -> None:
    assert own.solve(sample(1.0, d=0.0)).status == SOLVED
    own.prepare()
    assert own.feedback(sample(1.0, d=3.0)).status == CAPPED
    found = own.solve(sample(1.0, d=3.0))
    assert (found.status, found.iterations) == (SOLVED, 1)
    own.init()
    anew = own.solve(sample(1.0, d=3.0))
    assert found.control == pytest.approx(anew.control, abs=1e-6)
