"""Derives the units of results; an unknown unit (None) never conflicts."""

from __future__ import annotations

from fractions import Fraction

from compiler.ir.scalars.table import UnitRule
from spec_schema.late_dataclass import dataclass
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE as ONE
from spec_schema.units.unit import Unit

RADIAN = parse_unit("rad")


@dataclass(frozen=True, slots=True)
class UnitConflict:
    """Units that do not fit: the operation, an operand's unit and the unit that it requires."""

    operation: str
    found: Unit
    expected: Unit


Ruled = tuple[Unit | None, UnitConflict | None]


def same_unit(left: Unit, right: Unit) -> bool:
    """True if values in the two units can be added: equal scale and dimension; rad counts as 1."""
    return left.same_as(right)


def sum_unit(operation: str, left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a sum, difference, minimum, comparison or choice of two values."""
    # an unknown unit becomes the other one: checks are gradual (decision 0007)
    if left is None:
        return right, None
    if right is None or same_unit(left, right):
        return left, None
    # the unit of the first operand is the expected one
    return None, UnitConflict(operation, right, left)


def addition_unit(left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a sum.

    K added to degC gives degC; degC + degC gives degC, since half of it is a mean.
    """
    if left is not None and right is not None:
        for point, other in ((left, right), (right, left)):
            if point.offset != 0.0 and same_unit(other, point.difference):
                return point, None
    return sum_unit("+", left, right)


def subtraction_unit(left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a difference: degC - degC is K, degC - K is degC.

    If the second unit is unknown it may be either, so degC minus an unknown unit is unknown.
    """
    if right is not None and right.offset != 0.0 and (left is None or same_unit(left, right)):
        return right.difference, None
    if left is not None and left.offset != 0.0:
        if right is None:
            return None, None
        if same_unit(right, left.difference):
            return left, None
    return sum_unit("-", left, right)


def distance_unit(unit: Unit | None) -> Unit | None:
    """Unit of the distance between two values: K for values in degC."""
    return None if unit is None else unit.difference


def product_unit(left: Unit | None, right: Unit | None) -> Unit | None:
    """Unit of a product; a temperature in degC times a dimensionless factor stays in degC."""
    if left is None or right is None:
        return None
    for point, other in ((left, right), (right, left)):
        if point.offset != 0.0 and _is_number(other):
            return point
    return left.difference * right.difference


def quotient_unit(left: Unit | None, right: Unit | None) -> Unit | None:
    """Unit of a quotient; a temperature in degC divided by a dimensionless factor stays in degC."""
    if left is None or right is None:
        return None
    if left.offset != 0.0 and _is_number(right):
        return left
    return left.difference / right.difference


def _is_number(unit: Unit) -> bool:
    return unit.same_as(ONE) and unit.angle == 0


def power_unit(base: Unit | None, exponent: int | Fraction) -> Unit | None:
    """Unit of base^exponent; None if the unit of the base is unknown."""
    return None if base is None else base.power(exponent)


def function_unit(name: str, rule: UnitRule, arguments: tuple[Unit | None, ...]) -> Ruled:
    """Unit of the value of a scalar function, by the unit rule of its row in the table."""
    unit = arguments[0]
    match rule:
        case UnitRule.NUMBER | UnitRule.TO_ANGLE | UnitRule.ANGLE:
            expected = RADIAN if rule is UnitRule.ANGLE else ONE
            result = RADIAN if rule is UnitRule.TO_ANGLE else ONE
            # rad counts as 1 here
            for argument in arguments:
                if argument is not None and not same_unit(argument, expected):
                    return result, UnitConflict(name, argument, expected)
            return result, None
        case UnitRule.RATIO_TO_ANGLE:
            _, conflict = sum_unit(name, arguments[0], arguments[1])
            return RADIAN, conflict
        case UnitRule.SAME:
            return unit, None
        case UnitRule.SIGN:
            return ONE, None
        case UnitRule.ROOT:
            return power_unit(unit, Fraction(1, 2)), None
