"""Raw values of single numbers, which are kept, have the bits of those that are computed."""

from __future__ import annotations

import numpy as np
import pytest

from backends import raw_parameters
from compiler.ir.program import Parameter
from compiler.kernels.table import evaluate


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, 1e-300, 39.9, np.inf, np.nan])
def test_a_number_that_is_kept_has_the_bits_of_the_function(value: float):
    wanted = evaluate("log", np.array([value]))
    for _ in range(2):
        found = raw_parameters._log(np.array([value]))
        assert found.tobytes() == wanted.tobytes()
    assert raw_parameters._log(np.array(value)).shape == ()


@pytest.mark.parametrize(
    ("low", "high", "on"),
    [
        (1e6, 1e6 + 1e-8, 1e6),
        (1e6, 1e6 + 1e-8, 1e6 + 1e-8),
        (1e12, None, 1e12),
        (None, -1e12, -1e12),
        (-1.0, 1.0, 1.0),
    ],
)
def test_a_value_on_a_bound_has_a_raw_value(low: float | None, high: float | None, on: float):
    """A millionth of the range is lost beside bounds that are large against it."""
    bounded = Parameter(name="k", initial=(on,), minimum=low, maximum=high, scale=1e-3)
    raw, moved = raw_parameters.raw_value(bounded, np.array(on))
    assert moved
    assert np.isfinite(raw)
    assert np.isfinite(raw_parameters.physical_slope(bounded, raw))
    width = 1e-3 if low is None or high is None else high - low
    back = raw_parameters.physical_value(bounded, raw)
    assert abs(back - on) <= 2e-6 * width + 2 * np.spacing(abs(on))
