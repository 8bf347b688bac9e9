"""One meaning of second derivatives at kinks and infinite slopes, in formulas of x and k.

A kink has no curvature, a product with a factor 0 is 0 whichever it is, and where no factor is 0
and one is infinite so is the curvature. The expected numbers are those of the branch that is taken,
by hand.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from compiler.interpreter.interpreter import physical_weights
from msnn.simulation.linearize import linearize
from tests.language.compiled import compiled

INF = math.inf

CASES: dict[str, tuple[str, float, float, float, float, float]] = {
    # formula, x, k, and the curvatures in xx, xk, kk
    "product": ("x * k", 2.0, 3.0, 0.0, 1.0, 0.0),
    "square": ("x * x", 2.0, 0.0, 2.0, 0.0, 0.0),
    "cube": ("x ** 3", 2.0, 0.0, 12.0, 0.0, 0.0),
    "quotient": ("k / x", 2.0, 3.0, 0.75, -0.25, 0.0),
    "quotient_of_itself": ("x / x", 2.0, 0.0, 0.0, 0.0, 0.0),
    "power_of_itself": ("x ** x", 1.0, 0.0, 2.0, 0.0, 0.0),
    "exponent_0": ("x ** k", 2.0, 0.0, 0.0, 0.5, math.log(2.0) ** 2),
    "base_1": ("x ** k", 1.0, 3.0, 6.0, 1.0, 0.0),
    "angle": ("atan2(x, k)", 1.0, 1.0, -0.5, 0.0, 0.5),
    "operand_made_of_the_other": ("atan2(x * k, x)", 1.0, 0.0, 0.0, 0.0, 0.0),
    "abs_at_0": ("abs(x) * k", 0.0, 2.0, 0.0, 0.0, 0.0),
    "abs_below_0": ("abs(x) * k", -1.0, 2.0, 0.0, -1.0, 0.0),
    "square_of_abs_at_0": ("abs(x) ** 2", 0.0, 0.0, 0.0, 0.0, 0.0),
    "sign": ("sign(x) * x * k", 1.0, 1.0, 0.0, 1.0, 0.0),
    "clip_inside": ("clip(x, -1, 1) ** 2", 0.5, 0.0, 2.0, 0.0, 0.0),
    "clip_on_its_bound": ("clip(x, -1, 1) ** 2", 1.0, 0.0, 2.0, 0.0, 0.0),
    "clip_outside": ("clip(x, -1, 1) ** 2", 1.5, 0.0, 0.0, 0.0, 0.0),
    "clip_with_limits_that_cross": ("clip(x, k ** 2, -(k ** 2))", 0.3, 1.0, 0.0, 0.0, -2.0),
    "tie_of_a_max_goes_to_the_first": ("max(x ** 2, k ** 2)", 1.0, 1.0, 2.0, 0.0, 0.0),
    "branch_that_is_taken": ("where(x > 0, x ** 2, k * sqrt(x))", 1.0, 1.0, 2.0, 0.0, 0.0),
    "branch_that_is_not": ("where(x > 0, x * sqrt(x), k ** 2)", 0.0, 1.0, 0.0, 0.0, 2.0),
    "root_of_what_a_max_holds_at_0": ("sqrt(max(x, 0)) * k", -1.0, 1.0, 0.0, 0.0, 0.0),
    "root_at_0": ("sqrt(x)", 0.0, 0.0, -INF, 0.0, 0.0),
    "factor_0_after_the_root": ("k * sqrt(x)", 0.0, 0.0, 0.0, INF, 0.0),
    "root_of_a_product": ("sqrt(k * x)", 1.0, 0.0, 0.0, INF, -INF),
    "power_above_2": ("x ** 2.5", 0.0, 0.0, 0.0, 0.0, 0.0),
    "power_of_2": ("x ** (2 + 0 * k)", 0.0, 0.0, 2.0, 0.0, 0.0),
    "power_above_1": ("x ** 1.5", 0.0, 0.0, INF, 0.0, 0.0),
    "power_below_1": ("x ** 0.5", 0.0, 0.0, -INF, 0.0, 0.0),
    "logarithm_that_a_max_bounds": ("max(log(x), -5) * k", 0.0, 1.0, 0.0, 0.0, 0.0),
    "logarithm_that_saturates": ("tanh(log(x)) + k ** 2", 0.0, 1.0, 0.0, 0.0, 2.0),
    "quotient_that_a_min_bounds": ("min(1 / x, 5) * k", 0.0, 1.0, 0.0, 0.0, 0.0),
    "quotient_that_saturates": ("tanh(1 / x) + k ** 2", 0.0, 1.0, 0.0, 0.0, 2.0),
    "asin_that_is_clipped": ("asin(clip(x, -1, 1)) * k", 2.0, 1.0, 0.0, 0.0, 0.0),
    "asin_at_1": ("asin(x)", 1.0, 0.0, INF, 0.0, 0.0),
    "acos_at_minus_1": ("acos(x)", -1.0, 0.0, INF, 0.0, 0.0),
    "two_roots": ("sqrt(sqrt(max(x, 0))) * k", -1.0, 1.0, 0.0, 0.0, 0.0),
    "triangular_set": ("sum(phi(x) * c) * k", 0.5, 2.0, 0.0, 1.0, 0.0),
    "triangular_set_at_its_top": ("sum(phi(x) * c) * k", 1.0, 2.0, 0.0, 1.0, 0.0),
    "triangular_set_beyond_the_last": ("sum(phi(x) * c) * k", 3.0, 2.0, 0.0, 0.0, 0.0),
    "matrix_of_zeros": ("sum(sqrt(x) * z) + k ** 2", 0.0, 1.0, 0.0, 0.0, 2.0),
    "product_of_matrices": ("sum((z * sqrt(x)) @ Z) * k", 0.0, 1.0, 0.0, 0.0, 0.0),
}


def curvature(formula: str, x: float, k: float) -> tuple[np.ndarray, tuple[str, ...]]:
    program = compiled(f"""
        inputs: {{x: {{}}, k: {{}}}}
        dims: {{row: 2, column: 2, set: 3}}
        layers: {{phi: {{fuzzify: {{centers: [0, 1, 2], dim: set}}}}}}
        parameters:
          c: {{dims: set, init: [0, 1, 2], learn: false}}
          z: {{dims: row, init: 0, learn: false}}
          Z: {{dims: [row, column], init: 0, learn: false}}
        outputs: {{y: "{formula} + 0 * x + 0 * k"}}
        """)
    weights = physical_weights(program, {})
    found = linearize(program, {"x": x, "k": k}, {}, weights, {"y": 1.0})
    return found.hessians["uu"], found.infinite


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("case", CASES)
def test_curvature(case: str) -> None:
    formula, x, k, *wanted = CASES[case]
    found, _ = curvature(formula, x, k)
    expected = np.array([[wanted[0], wanted[1]], [wanted[1], wanted[2]]])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_matrices_that_are_not_finite_are_named() -> None:
    """The slope at 0 is finite, 0, and its own slope is not."""
    assert curvature("x ** 1.5", 0.0, 0.0)[1] == ("uu",)
    assert curvature("x ** 1.5", 1.0, 0.0)[1] == ()
