"""`interpolation` and `normalize`: slopes, units, mistakes; values are in `cases/`."""

from dataclasses import replace

import numpy as np
import pytest

from compiler.differentiation.reverse_mode import step_gradients
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Output
from tests.language.compiled import codes, compiled

HEAD = """
inputs: {x: m}
constants: {curve: {value: [1, 4, 9, 16], unit: N}}
layers:
  table: {interpolation: {x: [1, 2, 3, 4], y: [1, 4, 9, 16]}}
  line: {interpolation: {x: [1, 2, 3, 4], y: curve, outside: extrapolate}}
  free: {interpolation: {x: [1, 2, 3, 4], y: [1, 4, 9, 16], learn: true, unit: N}}
  scale: {normalize: {mean: 2, std: 0.5, unit: m}}
"""


def slope(layer: str, x: float) -> float:
    """The derivative that the differentiate pass makes of a table of x."""
    program = compiled(HEAD + f'outputs: {{y: "{layer}(x)"}}')
    builder = GraphBuilder(program.step)
    node = program.output("y").node
    found = step_gradients(builder, {node: builder.constant(1.0)}).signals["x"]
    program = replace(program, step=builder.graph(), outputs=(Output("slope", found),))
    log = {"x": np.array([x, x])}
    return float(Interpreter(program).step(log, np.array([0]), {}).outputs["slope"].item())


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


def test_units_of_tables_and_of_what_is_normalized_back() -> None:
    for layer in ("line", "free"):
        program = compiled(HEAD + f"outputs: {{y: {layer}(x)}}")
        unit = program.step[program.output("y").node].type.unit
        assert unit is not None
        assert unit.text == "N"
    program = compiled(HEAD + "outputs: {y: scale.inverse(scale(x))}")
    unit = program.step[program.output("y").node].type.unit
    assert unit is not None
    assert unit.text == "m"
    # values without a unit say nothing about it
    compiled(HEAD + "outputs: {y: {expr: table(x), unit: Pa}}")


def test_learned_values_are_a_parameter() -> None:
    assert compiled(HEAD + "outputs: {y: free(x)}").parameter("free.y").initial == (1, 4, 9, 16)


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
