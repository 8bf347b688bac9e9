"""Solves after samples from which no plan keeps the hard limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.run.method import Status
from tests.conditions import require_tool
from tests.features.control.specs import controller

BILINEAR = """
msnn: 1
name: bilinear
sample_time: 0.1 s
inputs: {u: {between: hold}}
states:
  p: {next: p + 0.1 * v * (1 + u), init: 0}
  v: {next: v + 0.1 * (u - p), init: 0}
outputs: {y: 1 * p}
mpc:
  horizon: 15
  controls: [u]
  cost: {stage: p**2 + 0.1 * u**2}
  bounds:
    u: {min: -2, max: 2}
    p: {min: -1, max: 1, hard: true}
    v: {min: -1.5, max: 1.5, hard: true}
  solver: {interior_point: {structure: STRUCTURE}}
"""
"""At u = -1 nothing moves p: a plan that stays there learns nothing of what p costs."""


@pytest.mark.parametrize("structure", ["staged", "condensed"])
def test_what_a_new_controller_solves_is_solved_after_infeasible_samples(
    structure: str, tmp_path: Path
) -> None:
    """At the second sample at the latest, however long nothing could be done before."""
    require_tool("gcc", install="apt install gcc")
    text = BILINEAR.replace("STRUCTURE", structure)
    used, fresh = (controller(tmp_path, text, "c") for _ in range(2))
    random = np.random.default_rng(0)
    counted, iterations, fewest = 0, 0, 0
    for _ in range(300):
        used.reset()
        fresh.reset()
        before = [used.solve(_drawn(random, 3, 3)) for _ in range(int(random.integers(1, 6)))]
        state = _drawn(random, 0.9, 1.2)
        wanted = fresh.solve(state)
        if before[-1].status is not Status.INFEASIBLE or wanted.status is not Status.SOLVED:
            continue
        first, second = used.solve(state), used.solve(state)
        assert second.status is Status.SOLVED, state
        counted += 1
        iterations += first.iterations
        fewest += wanted.iterations
    assert counted > 200
    assert iterations < 1.5 * fewest


def test_in_python_an_infeasible_plan_is_not_begun_at_either(tmp_path: Path) -> None:
    """But at the control that is applied; where nothing was planned before, at rest."""
    text = BILINEAR.replace("STRUCTURE", "staged")
    used, fresh = (controller(tmp_path, text, "python") for _ in range(2))
    good, hopeless = {"p": 0.5, "v": 0.3}, {"p": 3.0, "v": 3.0}

    def follows(*before: dict[str, float], applied: dict[str, float] | None) -> None:
        used.reset()
        statuses = [used.solve(state).status for state in before]
        assert statuses[-1] is Status.INFEASIBLE
        fresh.reset(control=applied)
        np.testing.assert_array_equal(
            used.solve(good).controls["u"], fresh.solve(good).controls["u"]
        )

    used.reset()
    kept = used.solve(good), used.solve(hopeless)
    follows(good, hopeless, applied={"u": float(kept[1].control["u"])})
    follows(hopeless, applied=None)
    follows(good, hopeless, hopeless, applied=None)


def _drawn(random: np.random.Generator, p: float, v: float) -> dict[str, float]:
    return {"p": float(random.uniform(-p, p)), "v": float(random.uniform(-v, v))}
