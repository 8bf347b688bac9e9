"""Headers, descriptions and `show` say how many iterations a call takes at most."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from msnn.cli.application import run
from tests.conditions import require_tool
from tests.features.control.specs import controller

PENDULUM = """
msnn: 1
name: pendulum
sample_time: 0.1 s
inputs: {u: {between: hold}}
targets: {seen: {}}
states:
  a: {next: a + 0.1 * w, init: 0, range: [-4, 4]}
  w: {next: w + 0.1 * (5 * sin(a) + u), init: 0, range: [-9, 9]}
outputs: {y: {expr: a, predicts: "seen[t]"}}
mpc:
  horizon: 12
  controls: [u]
  cost: {stage: a**2 + 0.1 * w**2 + 0.01 * u**2}
  bounds: {u: {min: -3, max: 3}}
  SOLVER
estimator:
  mhe:
    horizon: 5
    measured: {y: 0.1}
    process: {w: 0.1}
    initial: {a: 1, w: 1}
    SOLVER
"""
SOLVERS = {
    "converged": ("solver: {interior_point: {iterations: 2}}", 4),
    "fixed": ("solver: {interior_point: {mode: fixed, iterations: 2}}", 2),
}


@pytest.mark.parametrize("mode", SOLVERS)
def test_no_call_takes_more_iterations_than_is_said(
    mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("gcc", install="apt install gcc")
    solver, most = SOLVERS[mode]
    spec = tmp_path / "pendulum.msnn.yaml"
    spec.write_text(PENDULUM.replace("SOLVER", solver))
    assert run(["export", str(spec), "--initial", "--to", "mpc", "--out", str(tmp_path)]) == 0
    for part in ("mpc", "mhe"):
        header = (tmp_path / "mpc" / "include" / f"pendulum_{part}.h").read_text()
        (told,) = re.findall(r"Time of the worst case: that of (\d+) iterations\.", header)
        about = json.loads((tmp_path / "mpc" / f"pendulum_{part}.json").read_text())
        assert int(told) == about["most_iterations"] == most
        assert f"/* of this call: {most} at most */" in header
        assert ("second start" in header) is (mode == "converged")
    capsys.readouterr()
    assert run(["show", str(spec)]) == 0
    assert capsys.readouterr().out.count(f"{most} iterations a sample at most") == 2
    for backend in ("c", "python"):
        own = controller(tmp_path, PENDULUM.replace("SOLVER", solver), backend)
        random = np.random.default_rng(1)
        states = [dict(zip("aw", random.uniform((-3, -6), (3, 6)), strict=True)) for _ in range(40)]
        assert max(own.solve(state).iterations for state in states) == most
