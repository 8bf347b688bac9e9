"""What `export --check` says of a controller whose self-test fails."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from backends.c.host.build import build_library
from msnn.agreement.agreement import SelfTestFails
from msnn.features.control.backend import write_controller
from msnn.features.control.export.judged_controller import compare_controller
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.trained import trained
from tests.conditions import require_tool
from tests.features.control.specs import load

SPEC = """
msnn: 1
name: tank
sample_time: 1 s
inputs: {u: {between: hold}}
states: {x: {next: 0.9 * x + u - 0.01 * x**2, init: 0}}
outputs: {y: x}
mpc:
  horizon: 5
  controls: [u]
  cost: {stage: (x - 1)**2 + 0.1 * u**2}
  bounds: {u: {min: -1, max: 1}}
"""


def test_a_golden_solve_with_other_bits_is_no_plan_that_is_not_optimal(tmp_path: Path) -> None:
    """E1057 spoke of optimality conditions that are off by NaN, of plans that were CAPPED too."""
    require_tool("gcc", install="apt install gcc")
    control = load(tmp_path, SPEC).of(ControlProblem)
    assert control is not None
    problem = trained(replace(control, iterations=1), {})
    write_controller(problem, {}, tmp_path / "out", prefix="tank", dtype="float64")
    path = tmp_path / "out" / "src" / "tank_mpc_selftest.c"
    text = path.read_text(encoding="utf-8")
    before = "out.iterations != golden->iterations"
    assert before in text
    path.write_text(text.replace(before, "out.iterations == golden->iterations"), encoding="utf-8")
    build_library(tmp_path / "out", tmp_path / "out" / "controller.so")
    found = compare_controller(problem, {}, tmp_path / "out", "float64", "mpc")
    assert found.faults == (SelfTestFails("the self-test of the controller", 16),)
    assert found.faults[0].difference == "it returns 16, where 0 says that all is well"
