"""`weight:` and `bias:` that name parameters: values, sharing, and every backend."""

import numpy as np

from tests.language.compiled import Array, compiled, evaluated
from tests.language.every_backend import assert_backends_agree

GENERATOR = np.random.default_rng(31)
LOG = {
    "x": GENERATOR.normal(size=12),
    "v": GENERATOR.normal(size=12),
    "q": GENERATOR.normal(size=(12, 2)),
}
HEAD = """
dims: {joint: 2, tap: 3, o: 2, ch: 2}
inputs: {x: m, v: m, q: {dims: joint, unit: rad}}
parameters:
  taps: {dims: tap, init: [1, 2, 4], unit: N/m}
  rows: {dims: [joint, tap], init: 0.5 + i + 3 * j}
  square: {dims: [o, joint], init: 1 + i - 2 * j}
  cells: {dims: [ch, tap], init: 1 + i + j}
  offset: {init: 7, unit: N}
  offsets: {dims: joint, init: [1, -1]}
  both: {dims: o, init: [3, 5]}
layers:
  h: {fir: {window: 3, weight: taps, bias: offset}}
  g: {fir: {window: 3, weight: taps}}
  each: {fir: {window: 3, weight: rows, bias: offsets}}
  m: {linear: {out: o, weight: square, bias: both}}
  two: {linear: {weight: both, bias: false}}
  phi: {fuzzify: {centers: [-1, 1], dim: ch}}
  local: {local_model: {by: phi(v), cell: {fir: {window: 3, weight: cells}}}}
"""
T = 7
X, V, Q = LOG["x"][T - 2 : T + 1], LOG["v"][T - 2 : T + 1], LOG["q"][T - 2 : T + 1]
TAPS = np.array([1.0, 2.0, 4.0])
ROWS = 0.5 + np.arange(2)[:, None] + 3.0 * np.arange(3)


def value(expression: str) -> Array:
    return evaluated(HEAD + f'outputs: {{y: "{expression}"}}', LOG, T)


def test_a_filter_takes_its_taps_oldest_first_from_a_parameter():
    np.testing.assert_allclose(value("h(x)"), TAPS @ X + 7, rtol=1e-14)
    expected = np.sum(ROWS * Q.T, axis=1) + np.array([1.0, -1.0])
    np.testing.assert_allclose(value("each(q)"), expected, rtol=1e-13)


def test_a_linear_layer_takes_rows_of_its_results():
    square = 1.0 + np.arange(2)[:, None] - 2.0 * np.arange(2)
    np.testing.assert_allclose(value("m(q)"), square @ Q[-1] + [3, 5], rtol=1e-13)
    np.testing.assert_allclose(value("two(x, v)"), 3 * X[-1] + 5 * V[-1], rtol=1e-13)


def test_cells_of_a_local_model_are_the_first_axis_of_the_parameter():
    cells = 1.0 + np.arange(2)[:, None] + np.arange(3)
    high = np.clip((V[-1] + 1) / 2, 0, 1)
    expected = np.array([1 - high, high]) @ (cells @ X)
    np.testing.assert_allclose(value("local(x)"), expected, rtol=1e-13)


def test_layers_and_expressions_share_one_parameter():
    program = compiled(HEAD + 'outputs: {y: "h(x) + g(v) + taps @ v.past(3)"}')
    assert [parameter.name for parameter in program.parameters] == ["taps", "offset"]
    expected = TAPS @ X + 7 + 2 * TAPS @ V
    np.testing.assert_allclose(value("h(x) + g(v) + taps @ v.past(3)"), expected, rtol=1e-13)


def test_the_unit_of_a_result_follows_from_that_of_its_weights():
    program = compiled(HEAD + "outputs: {y: h(x)}")
    unit = program.step[program.outputs[0].node].type.unit
    assert unit is not None
    assert unit.text == "N"


def test_in_every_backend():
    outputs = "outputs: {a: h(x) + g(v), b: each(q), c: m(q), d: local(x)}"
    assert_backends_agree(HEAD + outputs, LOG, [3, 8])
