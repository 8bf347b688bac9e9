"""Buffers of states and equations in every target, beside the interpreter."""

from __future__ import annotations

from pathlib import Path

import pytest

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
inputs: {x: m, u: m, q: {dims: joint}}
parameters: {a: 0.6}
layers: {h: {fir: {window: 5}}}
states:
  s: {unit: m, next: "a * s + 0.3 * u - 0.1 * s[t-2]", init: 0.5, history: x}
  r: {unit: m, next: "0.5 * r + x[t-3]", init: r.meas}
equations:
  e: {expr: "0.5 * e[t-1] + 0.1 * q * s", history: 0.1}
  g: {expr: "tanh(s + r)", history: 0}
outputs:
  y: "h(s) + sum(e) + mean(g[t-3:t]) + r[t-1]"
  z: "e[t-2:t]"
"""


@pytest.mark.parametrize(("target", "dtype"), TYPES, ids=lambda value: value)
def test_histories(target: str, dtype: FloatType, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plan = plan_of(target, to_step_form(compiled(SPEC)), dtype)
    weights = initial_weights(plan.program)
    found = checked(plan, weights, tmp_path)
    assert found.agrees, found
    assert found.bits in (None, 0)
