"""sin, cos and tan of every finite angle."""

from __future__ import annotations

from collections.abc import Callable

from compiler.kernels.routines.angle_reduction import reduce_angle
from compiler.kernels.routines.double_word import ordered_sum, polynomial, reciprocal
from compiler.kernels.routines.hyperbolic import tiny, with_sign_of
from compiler.kernels.tables.coefficients import COSINE, HALF_PI, SINE, TANGENT
from compiler.kernels.trace.operations import branch, select
from compiler.kernels.trace.subroutine import Subroutine
from compiler.kernels.trace.values import Real, Value


def _sine(high: Real, low: Real) -> Real:
    """sin(high + low) on |high| ≤ π/4: high + (high·z·P(z) + low·(1 − z/2)), z = high²."""
    square = high * high
    cubic = high * (square * polynomial(square, SINE[high.format]))
    return high + (cubic + (low - 0.5 * square * low))


def _cosine(high: Real, low: Real) -> Real:
    """cos(high + low) on |high| ≤ π/4: 1 − z/2 + (z²·P(z) − high·low), z = high²."""
    square = high * high
    half = 0.5 * square
    whole = 1.0 - half
    rest = square * square * polynomial(square, COSINE[high.format])
    # (1 − whole) − z/2 is exactly the rounding error of `whole`
    return whole + (((1.0 - whole) - half) + (rest - high * low))


def _tangent(high: Real, low: Real) -> tuple[Real, Real]:
    """tan(high + low) on |high| ≤ π/4 in two words."""
    cubic = _tangent_beyond(high)
    slope = 1.0 + (high + cubic) * (high + cubic)
    return ordered_sum(high, cubic + low * slope)


def _tangent_beyond(x: Real) -> Real:
    """tan(x) − x on |x| ≤ π/4."""
    square = x * x
    return x * (square * polynomial(square, TANGENT[x.format]))


def _sin(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0
        value = branch(odd, lambda: _cosine(high, low), lambda: _sine(high, low), "value")
        return with_sign_of(x, select((quadrant & 2) > 0, -value, value))

    return (_finite_odd(x, size, general),)


def _cos(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0
        value = branch(odd, lambda: _sine(high, low), lambda: _cosine(high, low), "value")
        # negative in the quadrants 1 and 2
        return select(((quadrant + 1) & 2) > 0, -value, value)

    # ∞ − ∞ and NaN − NaN are NaN
    return (branch(size <= x.format.largest, general, lambda: x - x, "result"),)


def _tan(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0

        def direct() -> Real:
            tangent, rest = _tangent(high, low)
            return branch(odd, lambda: -reciprocal(tangent, rest), lambda: tangent + rest, "direct")

        def from_diagonal() -> Real:
            # tan(π/4 − w) = 1 − 2t/(1 + t), its inverse 1 + 2t/(1 − t), t = tan w
            word, rest = (0.5 * part for part in HALF_PI[x.format])
            remaining = (word - abs(high)) + (rest - with_sign_of(high, low))
            tangent = remaining + _tangent_beyond(remaining)
            signed = select(odd, -tangent, tangent)
            value = with_sign_of(high, 1.0 - (signed + signed) / (1.0 + signed))
            return select(odd, -value, value)

        # near π/4 the rounding error of the cubic term is significant
        value = branch(abs(high) < 0.67, direct, from_diagonal, "value")
        return with_sign_of(x, value)

    return (_finite_odd(x, size, general),)


def _finite_odd(x: Real, size: Real, general: Callable[[], Real]) -> Real:
    """x if tiny, NaN if infinite, elsewhere general()."""
    return branch(
        size < tiny(x.format),
        lambda: x,
        lambda: branch(size <= x.format.largest, general, lambda: x - x, "value_or_nan"),
        "result",
    )


SIN = Subroutine("sin", ("x",), "Sine of an angle in rad.", _sin)
COS = Subroutine("cos", ("x",), "Cosine of an angle in rad.", _cos)
TAN = Subroutine("tan", ("x",), "Tangent of an angle in rad.", _tan)
