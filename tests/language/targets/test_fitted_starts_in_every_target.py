"""States whose `init` is fitted, in every target: deployed code is told where it starts (R13)."""

from __future__ import annotations

from pathlib import Path

import pytest

from backends.c.interface.interface import c_interface
from backends.c_lowering.options import COptions
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judgement import FloatType
from msnn.model.weights.weights_file import initial_weights
from tests.agreement.exported import checked, plan_of
from tests.conditions import require_tool
from tests.language.compiled import compiled

TYPES: list[tuple[str, FloatType]] = [
    ("torch", "float64"),
    ("casadi", "float64"),
    ("onnx", "float64"),
    ("c", "float64"),
    ("c", "float32"),
]
SPEC = """
dims: {joint: 2}
inputs: {u: N}
targets: {q: m}
parameters: {k: 5}
states:
  x: {unit: m, next: "x + 0.05 * v", init: {fit: {over: 20, from: q.meas}}}
  v: {unit: m, next: "0.99 * v - 0.05 * k * x + 0.05 * u", init: {fit: {over: 20}}}
  w: {dims: joint, next: "0.9 * w + u", init: {fit: {over: 10}}}
  p: {next: "0.5 * p + u", init: 0.25}
outputs:
  y: {expr: "x + 0.1 * sum(w) + p", predicts: q}
"""


@pytest.mark.parametrize(("target", "dtype"), TYPES, ids=lambda value: value)
def test_fitted_starts(target: str, dtype: FloatType, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plan = plan_of(target, to_step_form(compiled(SPEC)), dtype)
    found = checked(plan, initial_weights(plan.program), tmp_path)
    assert found.agrees, found
    assert found.bits in (None, 0)


def test_reset_takes_what_no_step_can_know() -> None:
    interface = c_interface(to_step_form(compiled(SPEC)), COptions())
    assert [state.name for _, state in interface.supplied] == ["x", "v", "w"]
    # the log from which the search would begin is not asked for
    assert interface.windows == ()
    assert {"x", "v", "w"} == interface.from_record
