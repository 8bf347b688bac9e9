"""The derivatives of scalar functions of x = `a[0]`, or of x, p = `a`, with the function's value
`v`, and some functions expressed by others. `b` does the arithmetic.

In a product of factors of a derivative, 0 times infinity is 0: see decision 0184.
"""

from __future__ import annotations

from typing import Protocol, TypeVar

V = TypeVar("V")
W = TypeVar("W", contravariant=True)


class InfiniteFacts(Protocol[W]):
    """Answers which values can be infinite or 0, so that derivatives test only those
    (`InfiniteValues` does so for nodes).
    """

    def can_be_infinite(self, value: W, /) -> bool: ...
    def divides(self, value: W, /) -> bool: ...
    def is_never_zero(self, value: W, /) -> bool: ...


class Arithmetic(Protocol[V]):
    """Arithmetic on values of a type V: nodes of a graph (`GraphBuilder`), or floats in a test."""

    def constant(self, value: float, /) -> V: ...
    def add(self, left: V, right: V, /) -> V: ...
    def subtract(self, left: V, right: V, /) -> V: ...
    def multiply(self, left: V, right: V, /) -> V: ...
    def divide(self, left: V, right: V, /) -> V: ...
    def negate(self, value: V, /) -> V: ...

    def apply(self, function: str, /, *args: V) -> V:
        """Applies the scalar function of that name in `SCALAR_FUNCTIONS` to its arguments."""
        ...

    def where_negative(self, value: V, then: V, otherwise: V, /) -> V:
        """Element by element, `then` if `value` is below 0, else (also if it is NaN)
        `otherwise`.
        """
        ...

    @property
    def infinite_values(self) -> InfiniteFacts[V]:
        """The analysis of which values can be infinite or 0; only these are tested."""
        ...

    def zero_with(self, factor: V, product: V, /) -> V:
        """0 where `factor` is 0, otherwise `product`, the product with this factor. A NaN factor
        does not count as 0.
        """
        ...


def tangent(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """tan x = sin x / cos x of x = `a[0]`."""
    return b.divide(b.apply("sin", a[0]), b.apply("cos", a[0]))


def hyperbolic_sine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """sinh x = tanh x · cosh x of x = `a[0]`. Unlike (eˣ − e⁻ˣ)/2 it has no cancellation for small
    x.
    """
    return b.multiply(b.apply("tanh", a[0]), b.apply("cosh", a[0]))


def hyperbolic_cosine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """cosh x = e^|x| / 2 + 1 / (2 e^|x|) of x = `a[0]`."""
    grown = b.apply("exp", b.apply("abs", a[0]))
    half = b.constant(0.5)
    return b.add(b.multiply(half, grown), b.divide(half, grown))


def logistic(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """The logistic function 1 / (1 + e⁻ˣ) of x = `a[0]`, without overflow of an intermediate value:
    e^−|x| / (1 + e^−|x|) below 0, else 1 / (1 + e^−|x|).

    e⁻ˣ would overflow for large −x, and its square in the derivative already at half of that.
    """
    one, tail = b.constant(1.0), _tail(b, a[0])
    return b.divide(b.where_negative(a[0], tail, one), b.add(one, tail))


def soft_plus(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """The softplus log(1 + eˣ) of x = `a[0]`, computed as max(x, 0) + log(1 + e^−|x|)."""
    one, tail = b.constant(1.0), _tail(b, a[0])
    whole = b.add(one, tail)
    # r = rounding error of the sum w; to first order log(w + r) = log w + r/w keeps all its digits
    rest = b.subtract(tail, b.subtract(whole, one))
    logarithm = b.add(b.apply("log", whole), b.divide(rest, whole))
    return b.add(b.where_negative(a[0], b.constant(0.0), a[0]), logarithm)


def _tail(b: Arithmetic[V], x: V) -> V:
    """e^−|x|, computed by selecting −x or x. With |x| itself the derivative at 0 would be 0, which
    is wrong for the sigmoid and the softplus.
    """
    return b.apply("exp", b.where_negative(x, x, b.negate(x)))


def one_minus_square(b: Arithmetic[V], value: V) -> V:
    """1 − v² of the value v."""
    return b.subtract(b.constant(1.0), b.multiply(value, value))


def one_plus_square(b: Arithmetic[V], value: V) -> V:
    """1 + v² of the value v."""
    return b.add(b.constant(1.0), b.multiply(value, value))


def inverse(b: Arithmetic[V], value: V) -> V:
    """1 / v of the value v."""
    return b.divide(b.constant(1.0), value)


def sum_of_squares(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """a₀² + a₁² of the two arguments `a`."""
    return b.add(b.multiply(a[0], a[0]), b.multiply(a[1], a[1]))


LARGEST_SLOPE = 1e20
"""Training treats a larger derivative, or NaN, as infinite where it can be infinite. It is below
the finite values with which autodiff libraries replace an infinite derivative."""


def slope_product(b: Arithmetic[V], first: V, second: V) -> V:
    """The product first · second of two factors of a derivative: 0 where a factor is 0, even if the
    other is infinite.

    A test of a factor for 0 is only added if the other one can be infinite (or NaN, such as 0/0).
    """
    product = b.multiply(first, second)
    if b.infinite_values.can_be_infinite(first):
        product = b.zero_with(second, product)
    if b.infinite_values.can_be_infinite(second):
        product = b.zero_with(first, product)
    return product


def slope_quotient(b: Arithmetic[V], slope: V, divisor: V) -> V:
    """The derivative `slope` divided by `divisor`; 0 where the derivative is 0, even if the divisor
    is 0.
    """
    quotient = b.divide(slope, divisor)
    if b.infinite_values.divides(divisor):
        return quotient
    return b.zero_with(slope, quotient)


def divisor_slope(b: Arithmetic[V], slope: V, divisor: V, quotient: V) -> V:
    """The derivative by d = `divisor` of a result that depends on q = n/d (`quotient`): −s·q/d,
    where s (`slope`) is the derivative of the result by q.

    It is 0 where s is 0, even if d is 0.
    """
    if b.infinite_values.can_be_infinite(slope) or b.infinite_values.divides(divisor):
        return b.negate(slope_product(b, slope_quotient(b, slope, divisor), quotient))
    return b.zero_with(slope, b.negate(b.multiply(b.divide(slope, divisor), quotient)))


def of_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(sin x)′ = cos x."""
    return b.apply("cos", a[0])


def of_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(cos x)′ = −sin x."""
    return b.negate(b.apply("sin", a[0]))


def of_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(tan x)′ = 1 + tan² x."""
    return one_plus_square(b, v)


def of_arc_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(asin x)′ = 1 / √(1 − x²)."""
    return inverse(b, b.apply("sqrt", one_minus_square(b, a[0])))


def of_arc_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(acos x)′ = −1 / √(1 − x²)."""
    return b.negate(inverse(b, b.apply("sqrt", one_minus_square(b, a[0]))))


def of_arc_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(atan x)′ = 1 / (1 + x²)."""
    return inverse(b, one_plus_square(b, a[0]))


def of_hyperbolic_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(sinh x)′ = cosh x."""
    return b.apply("cosh", a[0])


def of_hyperbolic_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(cosh x)′ = sinh x."""
    return b.apply("sinh", a[0])


def of_hyperbolic_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(tanh x)′ = 1 − tanh² x."""
    return one_minus_square(b, v)


def of_exponential(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(eˣ)′ = eˣ."""
    return v


def of_logarithm(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(log x)′ = 1 / x, of the natural logarithm."""
    return inverse(b, a[0])


def of_square_root(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(√x)′ = 1 / (2 √x)."""
    return b.divide(b.constant(0.5), v)


def of_magnitude(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """|x|′ = sign x; 0 at x = 0."""
    return b.apply("sign", a[0])


def of_sign(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(sign x)′ = 0; NaN where x is NaN or infinite."""
    return b.multiply(b.constant(0.0), a[0])


def of_logistic(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """σ′(x) = σ(x) (1 − σ(x)) of the logistic function σ(x) = 1 / (1 + e⁻ˣ)."""
    return b.multiply(v, b.subtract(b.constant(1.0), v))


def of_soft_plus(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """(log(1 + eˣ))′ = σ(x) = 1 / (1 + e⁻ˣ)."""
    return b.apply("sigmoid", a[0])


def of_angle_in_y(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ atan2(y, x) / ∂y = x / (x² + y²), with y, x = `a`."""
    return b.divide(a[1], sum_of_squares(b, a))


def of_angle_in_x(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ atan2(y, x) / ∂x = −y / (x² + y²), with y, x = `a`."""
    return b.negate(b.divide(a[0], sum_of_squares(b, a)))


def of_power_in_base(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ xᵖ / ∂x = p xᵖ⁻¹, with x, p = `a`; 0 where p is 0."""
    return slope_product(b, a[1], b.apply("pow", a[0], b.subtract(a[1], b.constant(1.0))))


def of_power_in_exponent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ xᵖ / ∂p = xᵖ log x, with x, p = `a`; 0 where xᵖ or log x is 0."""
    return slope_product(b, v, b.apply("log", a[0]))


def curvatures_of_power(b: Arithmetic[V], a: tuple[V, ...], v: V) -> tuple[V, V, V]:
    """The second derivatives of xᵖ, with x, p = `a`: ∂²/∂x² = p (p−1) xᵖ⁻², ∂²/∂x∂p = xᵖ⁻¹ + p xᵖ⁻¹
    log x, ∂²/∂p² = xᵖ log² x.

    They are written out because the first derivatives are set to 0 where p or log x is 0. Their
    automatic derivatives would be 0 there as well, which is wrong.
    """
    x, p = a
    one = b.constant(1.0)
    less, logarithm = b.subtract(p, one), b.apply("log", x)
    slope = b.apply("pow", x, less)
    twice_less = b.apply("pow", x, b.subtract(p, b.constant(2.0)))
    in_base = slope_product(b, slope_product(b, p, less), twice_less)
    mixed = b.add(slope, slope_product(b, p, slope_product(b, slope, logarithm)))
    in_exponent = slope_product(b, slope_product(b, v, logarithm), logarithm)
    return in_base, mixed, in_exponent
