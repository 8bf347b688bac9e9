"""R9: the target of a loss comes from the log, whatever side of the comparison it is written on."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from tests.language.compiled import compiled

SPEC = """
inputs: {{u: m}}
states:
  x: {{unit: m, init: x.meas, next: 0.5 * x + u}}
  z: {{unit: m, init: 0, next: 0.5 * z}}
outputs: {{y: x}}
losses:
  fit: {loss}
"""
LOG = {"u": np.array([1.0, 2.0, 3.0]), "x": np.array([4.0, np.nan, 6.0])}


@pytest.mark.parametrize("loss", ["mse(x, x.meas)", "mse(x.meas, x)"])
def test_target_is_the_side_from_the_log(loss: str) -> None:
    interpreter = Interpreter(compiled(SPEC.format(loss=loss)))
    prediction, target = interpreter.step(
        LOG, 1, {"x": np.array([7.0]), "z": np.array([2.0])}
    ).losses["fit"]
    assert prediction[0] == 7.0
    assert target is not None
    assert np.isnan(target[0])  # not recorded, so not scored


def test_two_simulated_values_are_compared_by_their_difference() -> None:
    interpreter = Interpreter(compiled(SPEC.format(loss="mse(x, z)")))
    states = {"x": np.array([7.0]), "z": np.array([2.0])}
    prediction, target = interpreter.step(LOG, 1, states).losses["fit"]
    assert target is not None
    assert (prediction[0], target[0]) == (5.0, 0.0)
