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


@pytest.mark.parametrize(
    ("stages", "learned"),
    [
        ("", 4),
        ("[{freeze: w}]", 1),
        ("[{freeze: [w, c]}, {freeze: c}]", 3),
        ("[{freeze: w}, {freeze: c}]", 4),
        ("[{freeze: '*'}, {lr: {c: 0}}]", 3),
        ("[{lr: {'*': 0, w: 0.5}}, {freeze: w}]", 4),
        ("[{lr: {c: 0.5, '*': 0}}]", 0),
    ],
)
def test_numbers_that_no_stage_moves_are_no_learned_numbers(stages: str, learned: int):
    """Errors ±1 about their mean 0: n ln(2π) + n + 2p with n = 4, w of 3 numbers and c of one."""
    train = f"train: {stages}\n" if stages else ""
    program, spec = compiled(TEXT + train)
    u = np.arange(12.0).reshape(4, 3)
    y = u @ [1, -2, 0.5] + 0.375 + [1, -1, 1, -1]
    data = dataset({"u": u, "y": y}, test=[4])
    (row,) = validate(program, data, spec.checks, stages=spec.train).rows
    assert row.value == pytest.approx(4 * np.log(2 * np.pi) + 4 + 2 * learned, rel=1e-12)


@pytest.mark.parametrize(("error", "wanted"), [(0.0, -np.inf), (1.0, np.inf), (np.nan, np.nan)])
def test_errors_without_variance_have_the_limit(error: float, wanted: float):
    """No error has a likelihood without bound; a constant one contradicts its variance of 0."""
    program, spec = compiled(TEXT)
    u = np.zeros((4, 3))
    data = dataset({"u": u, "y": np.full(4, 0.375 - error)}, test=[4])
    (row,) = validate(program, data, spec.checks).rows
    np.testing.assert_equal(row.value, wanted)
