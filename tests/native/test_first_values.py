"""Raw values of single numbers, which are kept, have the bits of those that are computed."""

from __future__ import annotations

import numpy as np
import pytest

from backends import raw_parameters
from compiler.kernels.evaluate import evaluate


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, 1e-300, 39.9, np.inf, np.nan])
def test_a_number_that_is_kept_has_the_bits_of_the_function(value: float):
    wanted = evaluate("log", np.array([value]))
    for _ in range(2):
        found = raw_parameters._log(np.array([value]))
        assert found.tobytes() == wanted.tobytes()
    assert raw_parameters._log(np.array(value)).shape == ()
