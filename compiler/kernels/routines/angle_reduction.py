"""Reduces any finite angle to quarter turns and a remainder in two words."""

from __future__ import annotations

from typing import cast

from compiler.kernels.routines.double_word import ordered_sum
from compiler.kernels.routines.exponential import round_to_integer
from compiler.kernels.routines.huge_angle import reduce_huge
from compiler.kernels.tables.coefficients import HALF_PI_PARTS, TWO_OVER_PI
from compiler.kernels.trace.operations import branch_tuple, to_unsigned
from compiler.kernels.trace.subroutine import Subroutine
from compiler.kernels.trace.values import Real, Unsigned, Value

_RESULTS = ("high", "low", "quadrant")


def _largest_count(x: Real) -> float:
    """Maximum number of quarter turns whose product with a part of π/2 is exact."""
    return 2.0**7 if x.format.digits == 24 else 2.0**10


def _reduce_small(x: Real) -> tuple[Value, ...]:
    """x − count·π/2 after W. J. Cody and W. Waite, with π/2 in three words."""
    first, second, third = HALF_PI_PARTS[x.format]
    count = round_to_integer(x * TWO_OVER_PI[x.format][0]).named("count")
    # exact: the first part of π/2 is short enough for this number of quarter turns
    near = (x - count * first).named("closer")
    part = (count * second).named("part")
    difference = (near - part).named("difference")
    rest = ((near - difference) - part) - count * third
    high, low = ordered_sum(difference, rest)
    return high, low, to_unsigned(count) & 3


def _reduce(x: Real) -> tuple[Value, ...]:
    limit = _largest_count(x) / TWO_OVER_PI[x.format][0]
    return branch_tuple(x < limit, lambda: _reduce_small(x), lambda: reduce_huge(x), _RESULTS)


REDUCE_ANGLE = Subroutine(
    "reduce_angle",
    ("x",),
    "Finite x >= 0 as quadrant * pi/2 + high + low, |high| <= pi/4; the quadrant modulo 4.",
    _reduce,
    results=_RESULTS,
)


def reduce_angle(x: Real) -> tuple[Real, Real, Unsigned]:
    """high, low, quadrant with x ≡ quadrant·π/2 + high + low (mod 2π), |high| ≤ π/4, 0 ≤ x < ∞."""
    high, low, quadrant = REDUCE_ANGLE(x)
    return cast(Real, high), cast(Real, low), cast(Unsigned, quadrant)
