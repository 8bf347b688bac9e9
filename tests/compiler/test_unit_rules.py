"""Units through operations: what results have, and what does not fit."""

from __future__ import annotations

import pytest

from compiler.ir.rules import (
    UnitConflict,
    function_unit,
    power_unit,
    product_unit,
    quotient_unit,
    sum_unit,
)
from compiler.ir.scalars import SCALAR_FUNCTIONS
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit


def unit(text: str | None) -> Unit | None:
    """Of its text; None where it is not known."""
    return None if text is None else parse_unit(text)


@pytest.mark.parametrize(
    ("name", "given", "result", "wanted"),
    [
        # pure numbers, of which an angle is one
        ("exp", ["1"], "1", None),
        ("exp", ["rad"], "1", None),
        ("exp", ["m"], "1", "1"),
        ("exp", ["deg"], "1", "1"),
        ("pow", ["1", "s"], "1", "1"),
        ("tanh", [None], "1", None),
        # angles in radians
        ("sin", ["rad"], "1", None),
        ("sin", ["1"], "1", None),
        ("sin", ["deg"], "1", "rad"),
        ("sin", ["m"], "1", "rad"),
        # to an angle, which the unit says, though it counts as 1
        ("asin", ["1"], "rad", None),
        ("atan", ["m"], "rad", "1"),
        ("atan2", ["m", "m"], "rad", None),
        ("atan2", ["m", "s"], "rad", "m"),
        ("atan2", [None, "s"], "rad", None),
        # what keeps the unit, and what is without it
        ("abs", ["m/s"], "m/s", None),
        ("abs", [None], None, None),
        ("sign", ["m/s"], "1", None),
        ("sign", [None], "1", None),
        ("sqrt", ["m^2/s^2"], "m/s", None),
        ("sqrt", ["m^4"], "m^2", None),
        ("sqrt", [None], None, None),
    ],
)
def test_scalar_functions(
    name: str, given: list[str | None], result: str | None, wanted: str | None
) -> None:
    units = tuple(unit(text) for text in given)
    found, conflict = function_unit(name, SCALAR_FUNCTIONS[name].units, units)
    # not `same_as`, for which rad and 1 are alike
    assert found == unit(result)
    assert (None if conflict is None else conflict.expected) == unit(wanted)


def test_sums_take_the_unit_that_is_known() -> None:
    metre, second = parse_unit("m"), parse_unit("s")
    assert sum_unit("+", None, metre) == (metre, None)
    assert sum_unit("+", metre, None) == (metre, None)
    assert sum_unit("+", metre, second) == (None, UnitConflict("+", second, metre))
    # a millimetre is no metre: numbers would be added that mean others
    assert sum_unit("+", metre, parse_unit("mm"))[1] is not None
    assert sum_unit("+", parse_unit("degC"), parse_unit("K"))[1] is not None


def test_products_quotients_and_powers() -> None:
    metre, second = parse_unit("m"), parse_unit("s")
    assert product_unit(metre, second) == parse_unit("m*s")
    assert quotient_unit(metre, second) == parse_unit("m/s")
    assert power_unit(metre, 3) == parse_unit("m^3")
    assert product_unit(metre, None) is None
    assert quotient_unit(None, metre) is None
    assert power_unit(None, 2) is None
