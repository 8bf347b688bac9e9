"""Small problems of least squares end where they say, after as many steps as they say."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.simulation.gauss_newton import MOST_STEPS, RunProducts, descended


def test_no_more_steps_are_taken_than_were_promised_and_the_last_one_is_judged() -> None:
    """Of r = x² each step halves x, so that nothing settles within twenty."""
    asked: list[FloatArray] = []

    def products(members: IntArray, values: FloatArray) -> RunProducts:
        asked.append(values.copy())
        x = values[:, 0]
        slope, curvature = (2.0 * x**3)[:, None], (4.0 * x**2)[:, None, None]
        return RunProducts(x**4, slope, curvature, np.zeros_like(x))

    found = descended(np.array([[1.0]]), products)
    assert len(asked) == MOST_STEPS + 1  # the beginning and a place for each step
    np.testing.assert_allclose(found.values, 0.5**MOST_STEPS)
    assert not found.settled.any()


def test_infinite_squares_are_not_settled() -> None:
    def products(members: IntArray, values: FloatArray) -> RunProducts:
        squares = np.where(values[:, 0] > 1.0, np.inf, values[:, 0] ** 2)
        return RunProducts(
            squares, values.copy(), np.ones((len(values), 1, 1)), np.zeros(len(values))
        )

    found = descended(np.array([[9.0], [0.5]]), products)
    np.testing.assert_array_equal(found.settled, [False, True])
    np.testing.assert_array_equal(found.values, [[9.0], [0.0]])
