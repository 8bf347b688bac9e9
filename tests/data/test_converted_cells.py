"""Arrays of cells convert to the bits of numbers of a spec (`Unit.convert`)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msnn.data.reading.columns import converted_cells
from spec_schema.units.parser import parse_unit

_CORNERS = (0.0, math.inf, -math.inf, 999.999999999999, 1000.0, 1e15, 123456789012345.0, 1e-200)


@pytest.mark.parametrize(
    ("found", "wanted"),
    [
        *(("mm", "m"), ("us", "s"), ("deg", "rad"), ("rad", "deg"), ("km/h", "m/s")),
        *(("degC", "K"), ("K", "degC"), ("min", "s"), ("kN", "N"), ("rpm", "rad/s")),
    ],
)
def test_decimals_and_all_other_floats_convert_to_the_same_bits(found: str, wanted: str) -> None:
    random = np.random.default_rng(1)
    decimals = [random.integers(-(10**6), 10**6, 300) / 10**k for k in range(9)]
    # more digits than 15: from 1e-20 to 1e14
    floats = random.normal(size=300) * 10.0 ** random.uniform(-20, 14, 300)
    cells = np.concatenate([*decimals, floats, _CORNERS])
    unit, target = parse_unit(found), parse_unit(wanted)
    expected = [unit.convert(float(cell), target) for cell in cells]
    np.testing.assert_array_equal(converted_cells(cells, unit.line_to(target)), expected)


def test_scale_and_offset_are_decimals_too() -> None:
    line = parse_unit("mm").line_to(parse_unit("m")).after(0.1, 0.3)
    cells = np.array([3.0, 7.0, math.nan])
    np.testing.assert_array_equal(converted_cells(cells, line), [0.0006, 0.001, math.nan])


def test_factors_and_summands_beyond_the_floats_are_infinite() -> None:
    line = parse_unit("km").line_to(parse_unit("m"))
    cells = np.array([-2.0, 1.0, 3.0])
    expected = [-math.inf, math.inf, math.inf]
    np.testing.assert_array_equal(converted_cells(cells, line.after(1e308, 0.0)), expected)
    np.testing.assert_array_equal(converted_cells(cells, line.after(1.0, 1e308)), [math.inf] * 3)
