"""`init:` of parameters and layers: numbers, formulas of the index, shapes, draws, files."""

from pathlib import Path

import numpy as np
import pytest

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import read_spec
from tests.language.compiled import Array, compiled


def initial(init: str, dims: str = "tap", **also: str) -> Array:
    """The initial values of a parameter with these dims."""
    more = "".join(f"{section}: {text}\n" for section, text in also.items())
    program = compiled(f"""
dims: {{tap: 4, row: 2, other: 3}}
inputs: {{x: m}}
parameters: {{W: {{dims: [{dims}], init: {init}}}}}
{more}
outputs: {{y: sum(W) * x}}
""")
    found = program.parameter("W")
    return np.reshape(found.initial, [axis.size for axis in found.axes])


@pytest.mark.parametrize(
    ("init", "expected"),
    # the peer's values, measured: 4 taps, its defaults
    [
        ("negexp", [0.0498, 0.1353, 0.3679, 1]),
        ("exp", [1, 0.3679, 0.1353, 0.0498]),
        ("lin", [1, 2 / 3, 1 / 3, 0]),
    ],
)
def test_shapes_of_the_peer(init: str, expected: list[float]) -> None:
    # four digits are recorded
    np.testing.assert_allclose(initial(f"{{{init}: {{}}}}"), expected, atol=5e-5)


def test_shapes_have_options() -> None:
    x = np.arange(4) / 3
    found = initial("{exp: {first: 2, rate: 1}}")
    np.testing.assert_allclose(found, 2 * np.exp(-x), rtol=1e-15)
    found = initial("{negexp: {last: -1, rate: 2}}")
    np.testing.assert_allclose(found, -np.exp(-2 * (1 - x)), rtol=1e-15)
    np.testing.assert_allclose(initial("{lin: {first: -1, last: 1}}"), 2 * x - 1, atol=1e-15)


def test_shapes_run_along_the_last_axis_or_the_named_one() -> None:
    along = initial("{lin: {}}", "row, tap")
    np.testing.assert_allclose(along, [[1, 2 / 3, 1 / 3, 0]] * 2, rtol=1e-15)
    along = initial("{lin: {along: row}}", "row, tap")
    np.testing.assert_array_equal(along, [[1] * 4, [0] * 4])


@pytest.mark.parametrize("init", ["exp", "negexp", "lin"])
def test_one_element_has_the_value_that_is_named(init: str) -> None:
    np.testing.assert_array_equal(initial(f"{{{init}: {{}}}}", ""), 1)


def test_formula_of_the_index() -> None:
    np.testing.assert_array_equal(initial("0.5 * i + n"), [4, 4.5, 5, 5.5])
    i, j = np.mgrid[:2, :4]
    np.testing.assert_array_equal(initial("10 * i + j", "row, tap"), 10 * i + j)
    np.testing.assert_array_equal(initial("100 - i", "row, tap"), 100 - i)


def test_a_declared_name_is_no_index() -> None:
    np.testing.assert_array_equal(initial("2 * i", constants="{i: 7}"), [14] * 4)


def test_a_function_of_the_spec() -> None:
    functions = "{bump: {args: [a], expr: exp(-a * a)}}"
    found = initial("bump(i - 1.5)", functions=functions)
    np.testing.assert_allclose(found, np.exp(-((np.arange(4) - 1.5) ** 2)), rtol=1e-15)


def test_layers_take_the_same() -> None:
    program = compiled("""
dims: {o: 2}
inputs: {x: m}
layers:
  h: {fir: {window: 4, out: o, init: {negexp: {rate: 1}}}}
  m: {mlp: {hidden: 3, init: 0.1 * (i + 1)}}
outputs: {y: sum(h(x)) + m(x)}
""")
    taps = np.exp(-(1 - np.arange(4) / 3))
    np.testing.assert_allclose(program.parameter("h.weight").initial, [*taps, *taps], rtol=1e-15)
    np.testing.assert_allclose(program.parameter("m.weight1").initial, [0.1, 0.2, 0.3], rtol=1e-15)


def from_file(folder: Path, content: str | bytes, dims: str = "tap") -> Program:
    data = content if isinstance(content, bytes) else content.encode()
    (folder / "k.csv").write_bytes(data)
    text = f"""
msnn: 1
name: test
dims: {{tap: 4, row: 2}}
inputs: {{x: m}}
parameters: {{W: {{dims: [{dims}], init: {{file: k.csv}}}}}}
outputs: {{y: sum(W) * x}}
"""
    return compile_spec(read_spec(str(folder / "spec.yaml"), text).spec).program


@pytest.mark.parametrize("content", ["1, 2, 3e0, -4\n", "1\n2\n3 # third\n\n-4", "1;2;3;-4"])
def test_file_beside_the_spec(tmp_path: Path, content: str) -> None:
    assert from_file(tmp_path, content).parameter("W").initial == (1, 2, 3, -4)


def test_file_of_a_matrix(tmp_path: Path) -> None:
    program = from_file(tmp_path, "# two rows\n1 2 3 4\n5 6 7 8\n", "row, tap")
    assert program.parameter("W").initial == (1, 2, 3, 4, 5, 6, 7, 8)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("1, 2, 3", "it has 3 numbers"),
        ("1, 2\n3", "line 2 has 1 numbers"),
        ("1, 2, three, 4", "'three' in line 1"),
        ("1, 2, nan, 4", "not finite"),
        ("1, 2, 1e999, 4", "not finite"),
        ("", "no numbers"),
        (b"\xff\xfe\x00", "not UTF-8"),
    ],
)
def test_file_that_does_not_fit(tmp_path: Path, content: str | bytes, reason: str) -> None:
    with pytest.raises(SpecError, match="cannot take initial values") as raised:
        from_file(tmp_path, content)
    (found,) = raised.value.diagnostics
    assert found.code == "E0314"
    assert reason in found.message
