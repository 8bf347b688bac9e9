"""`linear`, `mlp` and `equation_learner`: values against plain numpy, in every backend."""

import numpy as np
import pytest

from compiler.elaboration.compile import compile_spec
from spec_schema.reading.reader import read_spec
from tests.language.compiled import Array, codes, compiled, evaluated
from tests.language.every_backend import assert_backends_agree

GENERATOR = np.random.default_rng(8)
LOG = {"x": GENERATOR.normal(size=(30, 3)), "u": GENERATOR.normal(size=30)}
X, U = LOG["x"], LOG["u"]
HEAD = """
dims: {i: 3, o: 2}
inputs: {x: {unit: "1", dims: i}, u: "1"}
functions:
  bump: {args: [a], expr: a * exp(-a**2)}
  blend: {args: [a, b], expr: 2 * a + 3 * b}
layers:
  deep: {mlp: {hidden: [5, 4], out: o}}
  bumpy: {mlp: {hidden: 4, activation: bump, bias: false}}
  square: {linear: {out: i}}
  several: {linear: {}}
  learner: {equation_learner: {functions: [sin, blend, mul, max], out: o}}
  raw: {equation_learner: {functions: [add, mul, identity], mix: false}}
  custom: {equation_learner: {functions: [blend, add, identity], mix: false}}
"""


def value(expression: str, **weights: Array) -> Array:
    named = {name.replace("__", "."): array for name, array in weights.items()}
    return evaluated(HEAD + f'outputs: {{y: "{expression}"}}', LOG, 10, named)


def normal(*shape: int) -> Array:
    return GENERATOR.normal(size=shape)


def test_mlp() -> None:
    w = {
        "deep__weight1": normal(5, 3),
        "deep__bias1": normal(5),
        "deep__weight2": normal(4, 5),
        "deep__bias2": normal(4),
        "deep__weight3": normal(2, 4),
        "deep__bias3": normal(2),
    }
    h = np.tanh(w["deep__weight1"] @ X[10] + w["deep__bias1"])
    h = np.tanh(w["deep__weight2"] @ h + w["deep__bias2"])
    # sums in another order than numpy's
    np.testing.assert_allclose(
        value("deep(x)", **w), w["deep__weight3"] @ h + w["deep__bias3"], rtol=1e-13
    )


def test_mlp_with_a_function_of_the_spec_over_a_window() -> None:
    w1, w2 = normal(4, 1), normal(4)
    z = w1 @ U[8:11][None, :]
    found = value("bumpy(u.past(3))", bumpy__weight1=w1, bumpy__weight2=w2)
    np.testing.assert_allclose(found, w2 @ (z * np.exp(-(z**2))), rtol=1e-12)


def test_mlp_starts_with_bounded_weights() -> None:
    program = compiled(HEAD + 'outputs: {y: "deep(x)"}')
    weight = np.array(program.parameter("deep.weight1").initial)
    assert 0 < np.max(np.abs(weight)) <= np.sqrt(6 / 8)
    assert set(program.parameter("deep.bias1").initial) == {0.0}


def test_linear_from_a_dimension_to_itself() -> None:
    w, b = normal(3, 3), normal(3)
    found = value("square(x)", square__weight=w, square__bias=b)
    np.testing.assert_allclose(found, w @ X[10] + b, rtol=1e-14)


def test_several_arguments_stand_side_by_side() -> None:
    w, b = normal(5), np.array(0.5)
    found = value("several(u, x, u[t-1])", several__weight=w, several__bias=b)
    np.testing.assert_allclose(found, w @ np.array([U[10], *X[10], U[9]]) + 0.5, rtol=1e-14)


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


def test_equation_learner() -> None:
    w, b, v, c = normal(7, 3), normal(7), normal(2, 4), normal(2)
    z = w @ X[10] + b
    terms = np.array([np.sin(z[0]), 2 * z[1] + 3 * z[2], z[3] * z[4], max(z[5], z[6])])
    found = value(
        "learner(x)",
        learner__weight_in=w,
        learner__bias_in=b,
        learner__weight_out=v,
        learner__bias_out=c,
    )
    np.testing.assert_allclose(found, v @ terms + c, rtol=1e-13)


def test_equation_learner_of_ones_reference_case_9() -> None:
    ones = {"raw__weight_in": np.ones((5, 1)), "raw__bias_in": np.zeros(5)}
    np.testing.assert_array_equal(value("raw(2 + 0 * u)", **ones), [4, 4, 2])
    ones = {"raw__weight_in": np.ones((5, 2)), "raw__bias_in": np.zeros(5)}
    np.testing.assert_array_equal(value("raw(1 + 0 * u, 3)", **ones), [8, 16, 4])
    ones = {"custom__weight_in": np.ones((5, 1)), "custom__bias_in": np.zeros(5)}
    np.testing.assert_array_equal(value("custom(2 + 0 * u)", **ones), [10, 4, 2])


def test_networks_as_cells() -> None:
    spec = """
dims: {ch: 2}
inputs: {x: m, v: m}
layers:
  phi: {fuzzify: {centers: [-1, 1], dim: ch}}
  net: {local_model: {by: phi(v), cell: {mlp: {hidden: 3}}}}
  eql: {local_model: {by: phi(v), cell: {equation_learner: {functions: [sin, mul]}}}}
  table: {local_model: {by: phi(v), cell: {interpolation: {x: [-1, 0, 1], y: [0, 1, 3]}}}}
outputs: {a: net(x), b: eql(x), c: table(x)}
"""
    log = {"x": normal(9), "v": normal(9)}
    weights = {
        "net.weight1": normal(2, 3, 1),
        "net.bias1": normal(2, 3),
        "net.weight2": normal(2, 3),
        "net.bias2": normal(2),
    }
    h = np.tanh(weights["net.weight1"] @ log["x"][4:5] + weights["net.bias1"])
    cells = np.sum(weights["net.weight2"] * h, axis=1) + weights["net.bias2"]
    upper = np.clip((log["v"][4] + 1) / 2, 0, 1)
    found = evaluated(spec, log, 4, weights, "a")
    np.testing.assert_allclose(found, cells @ [1 - upper, upper], rtol=1e-13)
    values = normal(2, 3)
    found = evaluated(spec, log, 4, {"table.y": values}, "c")
    tables = [np.interp(log["x"][4], [-1, 0, 1], row) for row in values]
    np.testing.assert_allclose(found, tables @ np.array([1 - upper, upper]), rtol=1e-13)
    assert_backends_agree(spec, log, [1, 4])


def test_backends_agree() -> None:
    outputs = """
outputs:
  a: deep(x)
  b: sum(bumpy(u.past(3)))
  c: several(u, x, u[t-1])
  d: learner(x)
"""
    assert_backends_agree(HEAD + outputs, LOG, [5, 12])


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
