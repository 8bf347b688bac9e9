"""W0743: slopes that are infinite inside declared ranges are said, and nothing else is."""

from __future__ import annotations

import pytest

from compiler.elaboration.compile import compile_spec
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.reading.reader import read_spec

SPEC = """
msnn: 1
name: steep
sample_time: 1 s
inputs: {u: {range: [0, 1]}, v: {range: [-1, 1]}, w: {range: [0.1, 2]}, n: {}, o: {}}
parameters: {k: 1, m: {init: 1, min: 0}, z: 0}
states: {s: {der: "u - sqrt(s)", range: [LOW, 5], init: 1}}
integrator: {rk4: {substeps: 2}}
equations: {e: {expr: n + o, range: [0, 4]}}
outputs: {y: {expr: "EXPR"}}
"""


def found(expr: str, low: float = 0.1) -> list[Diagnostic]:
    text = SPEC.replace("EXPR", expr).replace("LOW", str(low))
    warnings = compile_spec(read_spec("steep.yaml", text).spec).warnings
    return [each for each in warnings if each.code == "W0743"]


@pytest.mark.parametrize(
    ("expr", "name", "reached"),
    [
        ("sqrt(u)", "`u` in [0, 1]", "[0, 1]"),
        ("sqrt(u[t-1])", "`u` in [0, 1]", "[0, 1]"),
        ("sqrt(max(v, 0))", "`v` in [-1, 1]", "[0, 1]"),
        ("sqrt(w - 0.1)", "`w` in [0.1, 2]", "[0, 1.9]"),
        ("k * sqrt(max(u - z, 0))", "`u` in [0, 1]", "[0, 1]"),
        ("sqrt(m * u)", "`u` in [0, 1]", "[0, inf]"),
        ("where(v >= 0, sqrt(v), 0)", "`v` in [-1, 1]", "[0, 1]"),
        ("u**0.5", "`u` in [0, 1]", "[0, 1]"),
        ("log(u)", "`u` in [0, 1]", "[0, 1]"),
        ("w / v", "`v` in [-1, 1]", "[-1, 1]"),
        ("1 / tanh(2 * v)", "`v` in [-1, 1]", "[-0.964, 0.964]"),
        ("asin(v)", "`v` in [-1, 1]", "[-1, 1]"),
        ("acos(w)", "`w` in [0.1, 2]", "[0.1, 2]"),
        ("1 / cos(2 * v)", "`v` in [-1, 1]", "[-0.4161, 1]"),
        ("sqrt(e)", "`e` in [0, 4]", "[0, 4]"),
        ("sqrt(u * v + w)", "`u` in [0, 1] and `v` in [-1, 1] and `w` in [0.1, 2]", "[-0.9, 3]"),
    ],
)
def test_a_singular_point_within_declared_ranges_is_said(
    expr: str, name: str, reached: str
) -> None:
    (said,) = found(expr)
    assert said.notes == (f"with {name} it is in {reached}",)


@pytest.mark.parametrize(
    "expr",
    [
        "sqrt(w)",
        "sqrt(u + 1e-6)",
        "log(max(u, 1e-6))",
        "w / (1 + v * v)",
        "1 / cos(v)",
        "asin(0.9 * v)",
        "u**1.5",
        "v**2",
    ],
)
def test_ranges_without_a_singular_point_are_silent(expr: str) -> None:
    assert found(expr) == []


@pytest.mark.parametrize("expr", ["sqrt(n)", "sqrt(max(n, 0))", "u / (n + v)", "sqrt(n * w)"])
def test_what_follows_from_no_declared_range_is_silent(expr: str) -> None:
    assert found(expr) == []


@pytest.mark.parametrize(
    "expr",
    [
        "where(v > 0, sqrt(v), 0)",
        "where(v <= 0, 0, log(v))",
        "where(abs(v) > 0.01, u / v, 0)",
        "where(v * v > 0.01, u / v, 0)",
        "where(0.2 < v, where(u > 0.5, log(u), 0) / v, 0)",
    ],
)
def test_a_point_that_a_where_excludes_is_silent(expr: str) -> None:
    assert found(expr) == []


@pytest.mark.parametrize(
    "expr",
    [
        "sqrt(abs(v))",
        "sqrt(v * v + u * u)",
        "where(v > 0, sqrt(abs(v)), -sqrt(abs(v)))",
        "sqrt(relu(v))",
        "sqrt(max(0, v))",
        "relu(v)**0.5",
    ],
)
def test_an_infinite_slope_times_0_is_silent(expr: str) -> None:
    assert found(expr) == []


@pytest.mark.parametrize("expr", ["u / m", "u / (m + v * v)", "sqrt(m)"])
def test_bounds_of_learned_parameters_are_not_reached(expr: str) -> None:
    assert found(expr) == []


def test_arguments_clipped_to_where_they_are_defined_are_silent() -> None:
    assert found("asin(clip(2 * v, -1, 1))") == []


def test_stages_of_an_integrator_are_looked_at_where_states_are_as_declared() -> None:
    """Between them a state may seem to leave its range."""
    assert found("s", low=0.1) == []
    (said,) = found("s", low=0.0)
    assert said.notes == ("with `s` in [0, 5] it is in [0, 5]",)
