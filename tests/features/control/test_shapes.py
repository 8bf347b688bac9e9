"""Plants without memory, with vectors, with signals read ahead and late: all three agree."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

import msnn
from tests.features.control.specs import DOUBLE_INTEGRATOR, controller, load, mpc

MEMORYLESS = """
msnn: 1
name: memoryless
sample_time: 0.1 s
inputs: {u: {}}
outputs: {y: 2 * u}
mpc:
  horizon: 4
  controls: [u]
  references: {r: {preview: true}}
  cost: (y - r)**2 + 0.1 * u**2
  bounds: {u: {max: 1}}
"""
READ_AHEAD = """
msnn: 1
name: read_ahead
sample_time: 0.1 s
inputs: {u: {between: hold}, w: {between: linear}}
states: {x: {der: u + w - x, init: 0}}
outputs: {y: x}
mpc: {horizon: 6, controls: [u], cost: x**2 + 0.1 * u**2, bounds: {u: {max: 1}}, preview: [w]}
"""
VECTORS = """
msnn: 1
name: vectors
sample_time: 0.1 s
dims: {j: 2}
inputs: {u: {dims: j}, w: {dims: j}}
states: {x: {dims: j, next: "0.9 * x + u[t-2] + 0.1 * w[t-1]", init: 0}}
outputs: {y: x}
mpc:
  horizon: 6
  controls: [u]
  references: {low: {dims: j}}
  cost: sum(x**2) + 0.1 * sum((u - u[t-1])**2)
  bounds: {u: {max: 1, min: low, rate: 4}, x: {max: 3, min: low}}
  blocks: [2, 2, 2]
"""
Given = Mapping[str, ArrayLike]
CASES: dict[str, tuple[str, Given, Given, Given]] = {
    "without memory": (MEMORYLESS, {}, {"r": np.arange(5.0)}, {}),
    "read ahead": (READ_AHEAD, {"x": 1.0}, {}, {"w": np.arange(6.0)}),
    "vectors": (VECTORS, {"x": [1.0, -2.0]}, {"low": [-1.0, -0.5]}, {"w": [0.0, 1.0]}),
}


@pytest.mark.parametrize("name", CASES)
def test_solved_as_ipopt_and_fatrop_do(name: str, tmp_path: Path) -> None:
    text, x, references, disturbances = CASES[name]
    own = controller(tmp_path, text)
    for _ in range(2):  # once from nothing, once from the plan before
        found = own.solve(x, references=references, disturbances=disturbances)
        assert found.status == 0
        assert own.residuals(found).largest <= 1.001e-6
        assert found.given is not None
        assert found.plan is not None
        for solver in ("ipopt", "fatrop"):
            if name == "without memory" and solver == "fatrop":
                continue  # it wants stages, which follow from states
            other = own.casadi(solver).solve(found.given, found.plan)
            assert found.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6)


def test_weights_of_a_run_that_knew_no_controller(tmp_path: Path) -> None:
    """`mpc:` is no part of the model: weights trained without it are its plant."""
    (tmp_path / "log.csv").write_text(
        "time,u,p,v\n" + "".join(f"{k / 10},{np.sin(k)},0,0\n" for k in range(40))
    )
    spec = (
        DOUBLE_INTEGRATOR.replace("states:", "parameters: {gain: 0.1}\nstates:")
        .replace("v + 0.1 * u", "v + gain * u")
        .replace("{place: p}", '{place: {expr: next(v), predicts: "v[t+1]"}}')
    )
    data = "data: {source: {train: log.csv}, time: time}\ntrain: [{epochs: 1}]\n"
    run = msnn.train(load(tmp_path, spec + data)).folder
    model = load(tmp_path, spec + data + mpc(bounds="{u: {min: -1, max: 1}}"))
    assert msnn.mpc(model, run).solve({"p": 1.0, "v": 0.0}).status == 0
