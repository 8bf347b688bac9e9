"""`savitzky_golay`: values against polynomials and scipy's coefficients, units, mistakes."""

import numpy as np
import pytest

from tests.language.compiled import Array, codes, compiled, evaluated
from tests.language.every_backend import assert_backends_agree

DT = 0.1
T = DT * np.arange(40)


def value(options: str, x: Array, call: str = "d(x)") -> Array:
    spec = (
        f"inputs: {{x: m}}\nlayers: {{d: {{savitzky_golay: {options}}}}}\noutputs: {{y: {call}}}\n"
    )
    return evaluated(spec, {"x": x}, 20)


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
@pytest.mark.parametrize("lag", [0, 3, 7])
def test_polynomials_are_exact(derivative: int, lag: int) -> None:
    p = np.polynomial.Polynomial([1, -2, 0.5, 0.25])
    options = f"{{window: 8, order: 3, derivative: {derivative}, lag: {lag}}}"
    expected = p.deriv(derivative)(T[20 - lag]) if derivative else p(T[20 - lag])
    # the third difference of a window of 0.8 s loses three digits
    np.testing.assert_allclose(value(options, p(T)), expected, rtol=1e-9)


def test_the_published_smoothing_coefficients() -> None:
    # Savitzky and Golay 1964, table I: quadratic, five points, in the middle
    for k, expected in enumerate(np.array([-3, 12, 17, 12, -3]) / 35):
        unit = np.zeros(40)
        unit[16 + k] = 1
        found = value("{window: 5, order: 2, lag: 2}", unit)
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_line_of_two_samples_is_the_difference_quotient() -> None:
    x = np.sin(T)
    found = value("{window: 2, order: 1, derivative: 1}", x)
    np.testing.assert_allclose(found, (x[20] - x[19]) / DT, rtol=1e-12)


def test_units_and_vectors_in_every_backend() -> None:
    spec = """
dims: {joint: 2}
inputs: {q: {unit: rad, dims: joint}}
layers:
  speed: {savitzky_golay: {window: 0.5 s, derivative: 1}}
  smooth: {savitzky_golay: {window: 5, order: 0, lag: 0.2 s}}
equations: {dq: {expr: speed(q), unit: rad/s}}
outputs: {w: dq, q_smooth: smooth(q)}
"""
    assert compiled(spec).parameters == ()
    q = np.random.default_rng(0).normal(size=(40, 2))
    smooth = evaluated(spec, {"q": q}, 20, output="q_smooth")
    np.testing.assert_allclose(smooth, q[16:21].mean(axis=0), rtol=1e-13)
    assert_backends_agree(spec, {"q": q}, [6, 20])


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("{window: 3, order: 3}", "E0313"),
        ("{window: 5, order: 1, derivative: 2}", "E0313"),
        ("{window: 5, lag: 5}", "E0313"),
        ("{window: 5, order: 65}", "E0210"),
        ("{}", "E0403"),
    ],
)
def test_mistake(options: str, code: str) -> None:
    spec = f"inputs: {{x: m}}\nlayers: {{d: {{savitzky_golay: {options}}}}}\noutputs: {{y: d(x)}}\n"
    assert codes(spec) == [code]
