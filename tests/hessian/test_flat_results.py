"""Results that count as linear in the Hessian: that of a sum of squares is Gauss and Newton's."""

from __future__ import annotations

import numpy as np

from compiler.hessian.step_derivatives import DerivativeInterpreter, multiplier, step_derivatives
from tests.language.compiled import compiled

SPEC = """
sample_time: 1 s
inputs: {u: {}}
states: {x: {next: 0.9 * x + u, init: 0}}
outputs: {e: sin(x) - u, cost: (sin(x) - u)**2}
"""


def test_a_sum_of_squares_of_flat_outputs_has_the_curvature_of_its_slopes() -> None:
    program = compiled(SPEC)
    x, u = 0.7, 2.0
    exact = [[2 * np.cos(x) ** 2 - 2 * (np.sin(x) - u) * np.sin(x), -2 * np.cos(x)]]
    exact += [[-2 * np.cos(x), 2.0]]
    gauss_newton = 2 * np.outer([np.cos(x), -1.0], [np.cos(x), -1.0])
    for flat, expected in (((), exact), (("e",), gauss_newton)):
        found = step_derivatives(program, next_states=(), outputs=("cost",), flat=flat)
        states = {"x": np.array([x]), multiplier("cost"): np.array([1.0])}
        values = DerivativeInterpreter(found, program, {}).values(
            {"u": np.array([[u]])[0]}, np.array([0]), states
        )
        np.testing.assert_allclose(values.matrices["H"][0], expected, rtol=1e-14)
