"""Plants that leave the range of numbers within the horizon unless something is done."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conditions import require_tool
from tests.features.control.specs import controller

RUN_AWAY = """
msnn: 1
name: runs_away
sample_time: 0.1 s
inputs: {u: {between: hold}}
states: {x: {next: "x + 0.1 * (x + 0.3 * x**3 + 2 * u)", init: 0}}
outputs: {y: 1 * x}
mpc:
  horizon: 20
  controls: [u]
  cost: {stage: x**2 + 0.05 * u**2, terminal: 5 * x**2}
  bounds: {u: {min: -1, max: 1}}
  solver: {interior_point: {structure: STRUCTURE}}
"""


CASES = [("staged", x) for x in (-1.2, -0.5, 0.7, 1.0)] + [("condensed", 0.7), ("condensed", 1.0)]
"""Condensed, whose restart has no feedback, from states that are less far out."""


@pytest.mark.parametrize(("structure", "x"), CASES)
def test_a_plant_that_runs_away_at_rest_is_solved(structure: str, x: float, tmp_path: Path) -> None:
    """A first plan at rest ends beyond 1e69: nothing that begins there comes back."""
    require_tool("gcc", install="apt install gcc")
    text = RUN_AWAY.replace("STRUCTURE", structure)
    found = controller(tmp_path, text, "c").solve({"x": x})
    other = controller(tmp_path, text, "python").solve({"x": x})
    assert found.status == 0
    assert found.cost == pytest.approx(other.cost, rel=1e-6)
    np.testing.assert_allclose(found.control["u"], other.control["u"], rtol=1e-4)


@pytest.mark.parametrize("x", [-0.5, 0.7, 1.0])
def test_the_plan_of_a_plant_that_nothing_brings_back_is_not_begun_at(
    x: float, tmp_path: Path
) -> None:
    """The plan was cut, so that its numbers are finite, however far it jumps."""
    require_tool("gcc", install="apt install gcc")
    found = controller(tmp_path, RUN_AWAY.replace("STRUCTURE", "staged"), "c")
    assert found.solve({"x": 10.0}).status == 2
    assert found.solve({"x": x}).status == 0
