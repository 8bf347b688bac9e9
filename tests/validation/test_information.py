"""Akaike's criterion counts the numbers that training moves."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.validation.validate import validate
from tests.training.cases import compiled, dataset

TEXT = """
msnn: 1
name: counted
dims: {column: 3}
inputs: {u: {dims: column}}
targets: {y: 1}
parameters:
  held: {init: 0.25, learn: false}
  w: {dims: column, init: [1, -2, 0.5]}
  c: 0.125
outputs: {z: {expr: sum(w * u) + c + held, predicts: "y[t]"}}
validate: [{of: z, metric: aic}]
"""


def test_numbers_that_are_held_are_no_learned_numbers():
    """Three of an array and one beside it; n ln(2π var e) + Σe²/var e + 2 · 4."""
    random = np.random.default_rng(6)
    u = random.normal(size=(50, 3))
    error = random.normal(0.2, 0.4, 50)
    y = u @ [1, -2, 0.5] + 0.375 - error
    program, spec = compiled(TEXT)
    (row,) = validate(program, dataset({"u": u, "y": y}, test=[50]), spec.checks).rows
    variance = np.var(error)
    wanted = 50 * np.log(2 * np.pi * variance) + error @ error / variance + 2 * 4
    assert row.value == pytest.approx(wanted, rel=1e-12)
