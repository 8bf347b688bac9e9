"""Integrals, derivatives and gradients in every target, beside the interpreter."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.passes.simplify import prune_outputs
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
TIME = """
dims: {joint: 2}
inputs: {x: m, u: N, q: {dims: joint}}
layers: {h: {iir: {num: 1, den: 1}}}
states:
  s: {unit: m, next: "0.6 * s + 0.3 * u", init: 0.5}
  v: {unit: m/s, der: "u - 2 * v"}
equations: {area: {expr: "integral(q, init=0.5)", history: 0.1}}
outputs:
  y: "0.1 * integral(x, method=trapezoidal) + der(s) + der(x[t-1]) + der(v) + sum(area[t-2:t])"
  z: "0.1 * integral(s, method=trapezoidal) + der(h(x)) + der(der(s)) + area[t-1]"
  w: "der(x, method=trapezoidal) - integral(der(x, method=trapezoidal), method=trapezoidal)"
"""
# Case 6 of nnodely's tests, both directions and both rules.
PEER = """
sample_time: 1 s
inputs: {x: m}
outputs:
  first: der(x)
  second: der(der(x))
  sum: integral(x)
  sum2: integral(integral(x))
  mean: "integral(x, method=trapezoidal)"
  mean2: "integral(integral(x, method=trapezoidal), method=trapezoidal)"
  same: "integral(der(x, method=trapezoidal), method=trapezoidal)"
"""
GRADIENTS = """
dims: {joint: 2}
inputs: {x: {unit: 1}, z: {unit: 1}, q: {dims: joint}}
constants: {w: [1, 2, 3]}
layers:
  n: {mlp: {hidden: 4}}
  phi: {fuzzify: {centers: [-1, 0, 1]}}
  m: {local_model: {by: phi(x), cell: {linear: {}}}}
  table: {interpolation: {x: [-1, 0, 1], y: [1, 3, 2]}}
equations:
  u: n(x, z)
  u_x: grad(u, x)
  e: {expr: "0.5 * e[t-1] + x * x * z", history: 0}
outputs:
  burgers: "grad(u, z) + u * u_x - 0.1 * grad(u_x, x)"
  layers: "grad(m(z), x) + grad(m(z), z) + grad(table(x), x)"
  window: "grad(sum(w * x.past(3) * x.past(3)), x.past(2))"
  vector: "grad(sum(q * q) * sin(z), q) + grad(e, x)"
  branches: "grad(where(x > 0, sqrt(x), x * z), x) + grad(max(x, z), x) + grad(abs(z), z)"
"""


def _integrated(method: str) -> str:
    return f"""
dims: {{joint: 2}}
inputs: {{u: {{dims: joint}}, f: N}}
parameters: {{K: {{dims: joint, init: [8, 3]}}}}
equations: {{energy: "sum(0.5 * K * q * q) + 1 - cos(p)"}}
states:
  w: {{dims: joint, der: "u - grad(energy, q) - 0.5 * w * sum(w * w)", init: 0.2}}
  q: {{dims: joint, der: w, init: 0.1}}
  p: {{der: "f - grad(energy, p) - 0.3 * p"}}
integrator: {method}
outputs: {{y: q, z: "p + integral(p) + der(p)"}}
"""


SPECS = {
    "time": TIME,
    "peer": PEER,
    "gradients": GRADIENTS,
    "semi_implicit": _integrated("{semi_implicit: {substeps: 2}}"),
    "linear_implicit": _integrated("linear_implicit"),
    "midpoint": _integrated("midpoint"),
}


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize(("target", "dtype"), TYPES, ids=lambda value: value)
def test_calculus(spec: str, target: str, dtype: FloatType, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    program = compiled(SPECS[spec])
    program = prune_outputs(program, [output.name for output in program.outputs])
    plan = plan_of(target, to_step_form(program), dtype)
    weights = initial_weights(plan.program)
    found = checked(plan, weights, tmp_path)
    assert found.agrees, found
    assert found.bits in (None, 0)
