"""`interpolation` and `normalize`: values against plain numpy, in every backend."""

from dataclasses import replace

import numpy as np
import pytest

from compiler.differentiation.reverse_mode import step_gradients
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Output
from tests.language.compiled import Array, codes, compiled, evaluated
from tests.language.every_backend import assert_backends_agree

KNOTS, VALUES = np.array([1.0, 2, 3, 4]), np.array([1.0, 4, 9, 16])
ROWS, COLUMNS = np.array([0.0, 1, 3]), np.array([-1.0, 1])
GRID = np.array([[1.0, 2], [0, 5], [7, -3]])
GENERATOR = np.random.default_rng(11)
LOG = {
    "x": GENERATOR.uniform(-1, 6, size=30),
    "z": GENERATOR.uniform(-2, 2, size=30),
    "q": GENERATOR.normal(size=(30, 2)),
}
HEAD = """
dims: {joint: 2}
inputs: {x: m, z: "1", q: {unit: rad, dims: joint}}
constants: {curve: {value: [1, 4, 9, 16], unit: N}}
layers:
  table: {interpolation: {x: [1, 2, 3, 4], y: [1, 4, 9, 16]}}
  line: {interpolation: {x: [1, 2, 3, 4], y: curve, outside: extrapolate}}
  map: {interpolation: {x: [0, 1, 3], x2: [-1, 1], y: [[1, 2], [0, 5], [7, -3]]}}
  plane: {interpolation: {x: [0, 1], x2: [0, 1], y: [[1, 3], [2, 4]], outside: extrapolate}}
  free: {interpolation: {x: [1, 2, 3, 4], y: [1, 4, 9, 16], learn: true, unit: N}}
  scale: {normalize: {mean: 2, std: 0.5, unit: m}}
  each: {normalize: {mean: [0, 1], std: [2, 4], unit: rad}}
"""


def value(expression: str, x: float = 0, z: float = 0) -> Array:
    log = {"x": [x] * 5, "z": [z] * 5, "q": LOG["q"][:5]}
    return evaluated(HEAD + f'outputs: {{y: "{expression}"}}', log, 3)


def slope(layer: str, x: float) -> float:
    """The derivative that the differentiate pass makes of a table of x."""
    program = compiled(HEAD + f'outputs: {{y: "{layer}(x)"}}')
    builder = GraphBuilder(program.step)
    node = program.output("y").node
    found = step_gradients(builder, {node: builder.constant(1.0)}).signals["x"]
    program = replace(program, step=builder.graph(), outputs=(Output("slope", found),))
    log = {"x": np.array([x, x])}
    return float(Interpreter(program).step(log, np.array([0]), {}).outputs["slope"].item())


@pytest.mark.parametrize("x", [-3, 0.999, 1, 1.6, 2, 2.9, 3, 3.5, 4, 7])
@pytest.mark.parametrize("layer", ["table", "free"])
def test_table(layer: str, x: float) -> None:
    # a quotient times its divisor rounds twice; the peer gives 2.0 and 8.3 at 1.6 and 2.9
    np.testing.assert_allclose(value(f"{layer}(x)", x), np.interp(x, KNOTS, VALUES), rtol=1e-15)


@pytest.mark.parametrize(
    ("x", "expected"), [(-1, -5), (0, -2), (1, 1), (2.5, 6.5), (4, 16), (6, 30)]
)
def test_extrapolated_table(x: float, expected: float) -> None:
    np.testing.assert_allclose(value("line(x)", x), expected, rtol=1e-15)


@pytest.mark.parametrize("x", [-1, 0, 0.25, 1, 2, 3, 5])
@pytest.mark.parametrize("z", [-3, -1, 0.5, 1, 2])
def test_table_in_two_dimensions(x: float, z: float) -> None:
    along = [np.interp(z, COLUMNS, row) for row in GRID]
    np.testing.assert_allclose(value("map(x, z)", x, z), np.interp(x, ROWS, along), atol=4e-15)


def test_extrapolated_plane_stays_a_plane() -> None:
    for x, z in [(-2.0, 3.0), (4.0, -1.0), (0.5, 0.5), (3.0, 3.0)]:
        np.testing.assert_allclose(value("plane(x, z)", x, z), 1 + x + 2 * z, atol=1e-14)


@pytest.mark.parametrize(
    ("layer", "x", "expected"),
    [
        ("table", 0.5, 0),
        ("table", 1, 3),
        ("table", 2, 5),
        ("table", 4, 0),
        ("line", 0.5, 3),
        ("line", 1, 3),
        ("line", 3, 7),
        ("line", 4, 7),
        ("line", 9, 7),
    ],
)
def test_slope_on_a_knot_is_the_right_hand_one(layer: str, x: float, expected: float) -> None:
    assert slope(layer, x) == pytest.approx(expected, rel=1e-15)


def test_units_of_a_table() -> None:
    for layer in ("line", "free"):
        program = compiled(HEAD + f"outputs: {{y: {layer}(x)}}")
        unit = program.step[program.output("y").node].type.unit
        assert unit is not None
        assert unit.text == "N"
    # values without a unit say nothing about it
    compiled(HEAD + "outputs: {y: {expr: table(x), unit: Pa}}")


def test_learned_values_are_a_parameter() -> None:
    assert compiled(HEAD + "outputs: {y: free(x)}").parameter("free.y").initial == (1, 4, 9, 16)


def test_normalize_and_back() -> None:
    np.testing.assert_array_equal(value("scale(x)", 3), 2)
    np.testing.assert_array_equal(value("scale.inverse(2)"), 3)
    np.testing.assert_allclose(value("each(q)"), (LOG["q"][3] - [0, 1]) / [2, 4], rtol=1e-15)
    np.testing.assert_allclose(value("each.inverse(each(q))"), LOG["q"][3], rtol=1e-14)
    program = compiled(HEAD + "outputs: {y: scale.inverse(scale(x))}")
    unit = program.step[program.output("y").node].type.unit
    assert unit is not None
    assert unit.text == "m"


def test_backends_agree() -> None:
    outputs = """
outputs:
  a: table(x) + map(x, z)
  b: line(x)
  c: plane(x, z)
  d: free(x.past(4))
  e: each.inverse(2 * each(q))
"""
    assert_backends_agree(HEAD + outputs, LOG, [4, 9, 20])


@pytest.mark.parametrize(
    ("layer", "call", "code"),
    [
        ("{interpolation: {x: [0, 1]}}", "bad(x)", "E0203"),
        ("{interpolation: {x: [0, 1], y: [1, 2, 3]}}", "bad(x)", "E0402"),
        ("{interpolation: {x: [0, 1], x2: [0, 1], y: [1, 2]}}", "bad(x, z)", "E0402"),
        ("{interpolation: {x: [1, 0], y: [1, 2]}}", "bad(x)", "E0313"),
        ("{interpolation: {x: [1], y: [1]}}", "bad(x)", "E0313"),
        ("{interpolation: {x: [0, 1], y: [1, 2], outside: wrap}}", "bad(x)", "E0207"),
        ("{interpolation: {x: [0, 1], y: [1, 2]}}", "bad(x, z)", "E0305"),
        ("{interpolation: {x: [0, 1], y: [1, 2]}}", "sum(bad(q))", "E0402"),
        ("{interpolation: {x: [0, 1], y: [1, 2]}}", "bad.inverse(x)", "E0319"),
        ("{normalize: {mean: 0, std: 0}}", "bad(x)", "E0313"),
        ("{normalize: {mean: [0, 1, 2], std: 1}}", "sum(bad(q))", "E0402"),
        ("{normalize: {mean: z, std: 1}}", "bad(x)", "E0309"),
        ("{normalize: {mean: 0, std: 1}}", "bad.invers(x)", "E0319"),
    ],
)
def test_mistake(layer: str, call: str, code: str) -> None:
    spec = f"""
dims: {{joint: 2}}
inputs: {{x: m, z: "1", q: {{unit: rad, dims: joint}}}}
layers: {{bad: {layer}}}
outputs:
  y: {call} + x + z + sum(q)
"""
    assert code in codes(spec)
