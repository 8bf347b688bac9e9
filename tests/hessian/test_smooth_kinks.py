"""Smooth forms beside the kinks that they replace: how far they are, and how they bend."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.smooth_kinks import WIDTH, smooth_kinks
from msnn.simulation.linearize import linearize
from tests.language.compiled import compiled

FORMULAS = {
    # formula, and how far from it the smooth one may be, in widths of the kink
    "abs": ("abs(x)", 1.0),
    "max": ("max(x, k)", 1.0),
    "min": ("min(x, k)", 1.0),
    "relu": ("relu(x)", 0.5),
    "clip": ("clip(x, -1, 1)", 1.0),
    "where": ("where(x > 0, 2 * x, -x)", 1.0),
    "triangular_sets": ("sum(phi(x) * c)", 3.0),
    "partition_of_unity": ("sum(phi(x))", 3.0),
}
LARGEST = 2.0
"""Magnitude that the declared ranges allow for x; differences reach twice that."""


def program_of(formula: str):
    return compiled(f"""
        inputs: {{x: {{range: [-2, 2]}}, k: {{range: [-2, 2]}}}}
        dims: {{set: 3}}
        layers: {{phi: {{fuzzify: {{centers: [-1, 0, 1], dim: set}}}}}}
        constants: {{c: {{value: [-1, 0, 1], dims: set}}}}
        outputs: {{y: "{formula} + 0 * x + 0 * k"}}
        """)


@pytest.mark.parametrize("name", FORMULAS)
def test_values_are_near_and_curvature_is_finite(name: str) -> None:
    formula, widths = FORMULAS[name]
    program = program_of(formula)
    smooth = smooth_kinks(program)
    x = np.concatenate([np.linspace(-2, 2, 401), [1e-9, -1e-9]])
    log = {"x": x, "k": np.full(x.shape, 0.3)}
    rows = np.arange(len(x))
    sharp = Interpreter(program).step(log, rows, {}).outputs["y"]
    found = Interpreter(smooth).step(log, rows, {}).outputs["y"]
    np.testing.assert_allclose(found, sharp, rtol=0, atol=widths * WIDTH * 2 * LARGEST)
    for at in (-1.0, 0.0, 0.3, 1.0):
        curvature = linearize(smooth, {"x": at, "k": 0.3}, {}, {}, {"y": 1.0}).hessians["uu"]
        assert np.isfinite(curvature).all()
        # a kink of slope 1 over a width w bends by no more than 1/w; slopes jump by 3 at most
        assert np.abs(curvature).max() <= 3 / (WIDTH * LARGEST)


def test_roots_go_on_below_0() -> None:
    program = smooth_kinks(program_of("sqrt(max(x, 0)) + sign(x)"))
    values = Interpreter(program).step(
        {"x": np.array([-1.0, 0.0, 1.0]), "k": np.zeros(3)}, [0, 1, 2], {}
    )
    found = values.outputs["y"]
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, [-1.0, 0.0, 2.0], atol=0.05)  # the root of a width
    curvature = linearize(program, {"x": 0.0, "k": 0.0}, {}, {}, {"y": 1.0})
    assert curvature.infinite == ()


def test_what_no_range_reaches_stays_as_it_is() -> None:
    program = compiled("""
        inputs: {x: {range: [1, 2]}, k: {}}
        outputs: {y: "abs(x) + abs(k) + max(x, 0) + sqrt(x)"}
        """)
    assert smooth_kinks(program).step.nodes == program.step.nodes
