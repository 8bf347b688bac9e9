"""The kernels asin, acos, atan and atan2, with the argument reductions of fdlibm (Sun Microsystems,
1993).
"""

from __future__ import annotations

from compiler.kernels.routines.double_word import polynomial, split
from compiler.kernels.routines.hyperbolic import odd_near_zero, tiny, with_sign_of
from compiler.kernels.tables.coefficients import (
    ARC_SINE,
    ARC_TANGENT,
    ARC_TANGENT_HALF,
    ARC_TANGENT_ONE,
    ARC_TANGENT_THREE_HALVES,
    HALF_PI,
)
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.values import (
    Real,
    Subroutine,
    Truth,
    Value,
    branch,
    branch_tuple,
    call,
    constant,
    select,
    square_root,
)


def _half_angle(size: Real) -> tuple[Real, Real]:
    """asin √((1 − size)/2) for ½ ≤ size ≤ 1, as two reals to be added: a short one with half the
    digits, and the remainder.
    """
    square = 0.5 * (1.0 - size)
    root = square_root(square).named("root")
    short, _ = split(root)
    # √q − s = (q − s²)/(√q + s): s has half the digits, so that s² and the difference are exact
    missing = (square - short * short) / select(square > 0.0, root + short, 1.0)
    return short, missing + root * (square * polynomial(square, ARC_SINE[size.format]))


def _not_a_number(x: Real) -> Real:
    return (x - x) / (x - x)


def _asin(x: Real) -> tuple[Value, ...]:
    half_pi, half_pi_rest = HALF_PI[x.format]
    size = abs(x).named("size")

    def large() -> Real:
        # π/2 − 2·asin √((1 − |x|)/2)
        short, rest = _half_angle(size)
        return with_sign_of(x, (half_pi - 2.0 * short) - (2.0 * rest - half_pi_rest))

    def small() -> Real:
        return branch(
            size < tiny(x.format), lambda: x, lambda: odd_near_zero(x, ARC_SINE[x.format]), "small"
        )

    def not_small() -> Real:
        return branch(size <= 1.0, large, lambda: _not_a_number(x), "large")

    return (branch(size <= 0.5, small, not_small, "result"),)


def _acos(x: Real) -> tuple[Value, ...]:
    half_pi, half_pi_rest = HALF_PI[x.format]
    size = abs(x).named("size")

    def small() -> Real:
        square = x * x
        cubic = x * (square * polynomial(square, ARC_SINE[x.format]))
        return half_pi - (x - (half_pi_rest - cubic))

    def large() -> Real:
        short, rest = _half_angle(size)
        # 2·asin √((1 − x)/2), or π minus that of −x
        near_pi = 2.0 * ((half_pi - short) - (rest - half_pi_rest))
        return select(x < 0.0, near_pi, 2.0 * (short + rest))

    def not_small() -> Real:
        return branch(size <= 1.0, large, lambda: _not_a_number(x), "large")

    return (branch(size <= 0.5, small, not_small, "result"),)


def _atan_reduced(size: Real) -> tuple[Real, Real, Real, Real]:
    """Returns numerator, denominator, base and base_rest with atan size = base + base_rest +
    atan(numerator/denominator), for size ≥ 0.

    The quotient is within ±7/16: atan x − atan c = atan((x − c)/(1 + c·x)) for c = ½, 1, 3/2 or ∞.
    """

    def at_half() -> tuple[Real, ...]:
        # both doubled: 2x − 1 is exact
        return 2.0 * size - 1.0, 2.0 + size, *words(ARC_TANGENT_HALF)

    def at_one() -> tuple[Real, ...]:
        return size - 1.0, 1.0 + size, *words(ARC_TANGENT_ONE)

    def at_three_halves() -> tuple[Real, ...]:
        return size - 1.5, 1.0 + 1.5 * size, *words(ARC_TANGENT_THREE_HALVES)

    def words(table: dict[Format, tuple[float, ...]]) -> tuple[Real, ...]:
        return tuple(constant(size, word) for word in table[size.format])

    def at_infinity() -> tuple[Real, ...]:
        return constant(size, -1.0), size, *words(HALF_PI)

    def identity() -> tuple[Real, ...]:
        zero = constant(size, 0.0)
        return size, constant(size, 1.0), zero, zero

    names = ("numerator", "denominator", "base", "base_rest")

    def above_middle() -> tuple[Value, ...]:
        return branch_tuple(size < 39.0 / 16.0, at_three_halves, at_infinity, names)

    def above_low() -> tuple[Value, ...]:
        return branch_tuple(size < 19.0 / 16.0, at_one, above_middle, names)

    def above_identity() -> tuple[Value, ...]:
        return branch_tuple(size < 11.0 / 16.0, at_half, above_low, names)

    numerator, denominator, base, rest = branch_tuple(
        size < 7.0 / 16.0, identity, above_identity, names
    )
    assert isinstance(numerator, Real)
    assert isinstance(denominator, Real)
    assert isinstance(base, Real)
    assert isinstance(rest, Real)
    return numerator, denominator, base, rest


def _atan(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        numerator, denominator, base, rest = _atan_reduced(size)
        quotient = (numerator / denominator).named("quotient")
        square = quotient * quotient
        cubic = quotient * (square * polynomial(square, ARC_TANGENT[x.format]))
        return with_sign_of(x, base + ((cubic + rest) + quotient))

    return (branch(size < tiny(x.format), lambda: x, general, "result"),)


def is_negative(x: Real, name: str) -> Truth:
    """True if the sign bit of x is set, also for −0; x is not NaN. `name` is the name of the local
    variable in generated code.
    """
    # comparisons cannot distinguish −0 from 0, but 1/−0 is −∞
    sign = branch(abs(x) > 0.0, lambda: x, lambda: 1.0 / x, name)
    return sign < 0.0


def _atan2(y: Real, x: Real) -> tuple[Value, ...]:
    half_pi, half_pi_rest = HALF_PI[x.format]
    height = abs(y).named("height")
    width = abs(x).named("width")
    both_zero = (height <= 0.0) & (width <= 0.0)
    largest = x.format.largest
    both_infinite = (height > largest) & (width > largest)
    undecided = both_zero | both_infinite
    # 0/0 and ∞/∞ would be NaN; C's atan2 gives angles of an axis and a diagonal
    decided = select(both_zero, 0.0, 1.0)
    ratio = branch(undecided, lambda: decided, lambda: height / width, "ratio")
    angle = call(ATAN, ratio)
    beyond = 2.0 * half_pi - (angle - 2.0 * half_pi_rest)
    turned = select(is_negative(x, "side"), beyond, angle)
    return (select(is_negative(y, "sign"), -turned, turned),)


ASIN = Subroutine("asin", ("x",), "Arc sine in rad, -pi/2 .. pi/2.", _asin)
ACOS = Subroutine("acos", ("x",), "Arc cosine in rad, 0 .. pi.", _acos)
ATAN = Subroutine("atan", ("x",), "Arc tangent in rad, -pi/2 .. pi/2.", _atan)
ATAN2 = Subroutine("atan2", ("y", "x"), "Angle of the point (x, y) in rad, -pi .. pi.", _atan2)
