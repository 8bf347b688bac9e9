"""`linear`, `mlp` and `equation_learner`: first weights, mistakes; values are in `cases/`."""

import numpy as np
import pytest

from compiler.elaboration.compile import compile_spec
from spec_schema.reading.reader import read_spec
from tests.language.compiled import codes, compiled


def test_mlp_starts_with_bounded_weights() -> None:
    program = compiled("""
dims: {i: 3, o: 2}
inputs: {x: {dims: i}}
layers: {deep: {mlp: {hidden: [5, 4], out: o}}}
outputs: {y: deep(x)}
""")
    weight = np.array(program.parameter("deep.weight1").initial)
    assert 0 < np.max(np.abs(weight)) <= np.sqrt(6 / 8)
    assert set(program.parameter("deep.bias1").initial) == {0.0}


def test_arguments_of_different_units_stand_side_by_side_without_a_warning() -> None:
    text = """
msnn: 1
name: test
inputs: {x: m, F: N}
layers: {net: {mlp: {hidden: 4}}}
outputs:
  y: net(x, F)
"""
    assert compile_spec(read_spec("test.yaml", text).spec, strict_units=True).warnings == ()


@pytest.mark.parametrize(
    ("layer", "call", "code"),
    [
        ("{mlp: {out: o}}", "bad(x)", "E0203"),
        ("{mlp: {hidden: 0}}", "bad(x)", "E0210"),
        ("{mlp: {hidden: 3, activation: tahn}}", "bad(x)", "E0301"),
        ("{mlp: {hidden: 3, activation: atan2}}", "bad(x)", "E0305"),
        ("{mlp: {hidden: 3, dropout: 1}}", "bad(x)", "E0210"),
        ("{mlp: {hidden: 3}}", "bad()", "E0305"),
        ("{mlp: {hidden: 3}}", "bad(x) + bad(u)", "E0404"),
        ("{mlp: {hidden: 3}}", "bad(u.past(3), u.past(4))", "E0402"),
        ("{linear: {out: o}}", "sum(bad(M * x))", "E0402"),
        ("{equation_learner: {functions: [sinus]}}", "bad(x)", "E0301"),
        ("{equation_learner: {functions: [x]}}", "bad(x)", "E0304"),
        ("{equation_learner: {functions: [sin]}}", "sum(bad(M * x))", "E0402"),
    ],
)
def test_mistake(layer: str, call: str, code: str) -> None:
    spec = f"""
dims: {{i: 3, o: 2}}
inputs: {{x: {{unit: "1", dims: i}}, u: "1"}}
constants: {{M: {{value: [[1, 2, 3], [4, 5, 6]], dims: [o, i]}}}}
layers: {{bad: {layer}}}
outputs:
  y: {call} + sum(x) + u
"""
    assert code in codes(spec)
