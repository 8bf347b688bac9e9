"""Defines the derivatives of scalar functions, from their arguments `a` and their value `v`.

0 times any factor of a derivative is 0, also times infinity: see decision 0184.
"""

from __future__ import annotations

from typing import Protocol, TypeVar

V = TypeVar("V")
W = TypeVar("W", contravariant=True)


class InfiniteFacts(Protocol[W]):
    """Tells which values can be infinite or 0, so that derivatives test only those
    (`InfiniteValues`).
    """

    def can_be_infinite(self, value: W, /) -> bool: ...
    def divides(self, value: W, /) -> bool: ...
    def is_never_zero(self, value: W, /) -> bool: ...


class Arithmetic(Protocol[V]):
    """Arithmetic on values of one kind: nodes of a graph, or floats in a test."""

    def constant(self, value: float, /) -> V: ...
    def add(self, left: V, right: V, /) -> V: ...
    def subtract(self, left: V, right: V, /) -> V: ...
    def multiply(self, left: V, right: V, /) -> V: ...
    def divide(self, left: V, right: V, /) -> V: ...
    def negate(self, value: V, /) -> V: ...

    def apply(self, function: str, /, *args: V) -> V:
        """Applies the scalar function of that name."""
        ...

    def where_negative(self, value: V, then: V, otherwise: V, /) -> V:
        """`then` where the value is below 0, otherwise (also for NaN) `otherwise`."""
        ...

    @property
    def infinite_values(self) -> InfiniteFacts[V]:
        """Facts about values, so that only possibly infinite ones are tested."""
        ...

    def zero_with(self, factor: V, product: V, /) -> V:
        """0 where the factor is 0, otherwise the product. A NaN factor does not count as 0."""
        ...


def tangent(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """sin / cos."""
    return b.divide(b.apply("sin", a[0]), b.apply("cos", a[0]))


def hyperbolic_sine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """tanh x · cosh x. Unlike (eˣ − e⁻ˣ)/2 it has no cancellation for small x, as cosh x ≥ 1."""
    return b.multiply(b.apply("tanh", a[0]), b.apply("cosh", a[0]))


def hyperbolic_cosine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """e^|x| / 2 + 1 / (2 e^|x|)."""
    grown = b.apply("exp", b.apply("abs", a[0]))
    half = b.constant(0.5)
    return b.add(b.multiply(half, grown), b.divide(half, grown))


def logistic(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """e^−|x| / (1 + e^−|x|) below 0, else 1 / (1 + e^−|x|): no intermediate value overflows.

    In 1 / (1 + e⁻ˣ), e⁻ˣ overflows for large −x; its square in the derivative overflows at half of
    that.
    """
    one, tail = b.constant(1.0), _tail(b, a[0])
    return b.divide(b.where_negative(a[0], tail, one), b.add(one, tail))


def soft_plus(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """max(x, 0) + log(1 + e^−|x|)."""
    one, tail = b.constant(1.0), _tail(b, a[0])
    whole = b.add(one, tail)
    # r = rounding error of the sum w; to first order log(w + r) = log w + r/w keeps all its digits
    rest = b.subtract(tail, b.subtract(whole, one))
    logarithm = b.add(b.apply("log", whole), b.divide(rest, whole))
    return b.add(b.where_negative(a[0], b.constant(0.0), a[0]), logarithm)


def _tail(b: Arithmetic[V], x: V) -> V:
    """e^−|x|, by selecting −x or x: |x| has derivative 0 at 0, but both functions do not."""
    return b.apply("exp", b.where_negative(x, x, b.negate(x)))


def one_minus_square(b: Arithmetic[V], value: V) -> V:
    """1 − v²."""
    return b.subtract(b.constant(1.0), b.multiply(value, value))


def one_plus_square(b: Arithmetic[V], value: V) -> V:
    """1 + v²."""
    return b.add(b.constant(1.0), b.multiply(value, value))


def inverse(b: Arithmetic[V], value: V) -> V:
    """1 / v."""
    return b.divide(b.constant(1.0), value)


def sum_of_squares(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """a₀² + a₁²."""
    return b.add(b.multiply(a[0], a[0]), b.multiply(a[1], a[1]))


LARGEST_SLOPE = 1e20
"""Training treats a larger derivative, or NaN, as infinite where it can be infinite. It is below
the finite values with which autodiff libraries replace an infinite derivative."""


def slope_product(b: Arithmetic[V], first: V, second: V) -> V:
    """The product of two factors of a derivative: 0 where a factor is 0, even if the other is
    infinite.

    The code tests a factor for 0 only if the other one can be infinite (or NaN, such as 0/0).
    """
    product = b.multiply(first, second)
    if b.infinite_values.can_be_infinite(first):
        product = b.zero_with(second, product)
    if b.infinite_values.can_be_infinite(second):
        product = b.zero_with(first, product)
    return product


def slope_quotient(b: Arithmetic[V], slope: V, divisor: V) -> V:
    """A derivative divided by `divisor`; 0 where the derivative is 0, even if the divisor is 0."""
    quotient = b.divide(slope, divisor)
    if b.infinite_values.divides(divisor):
        return quotient
    return b.zero_with(slope, quotient)


def divisor_slope(b: Arithmetic[V], slope: V, divisor: V, quotient: V) -> V:
    """The derivative of `quotient` by its divisor times an outer derivative, −outer · quotient /
    divisor.

    It is 0 where the outer derivative is 0, even if the divisor is 0.
    """
    if b.infinite_values.can_be_infinite(slope) or b.infinite_values.divides(divisor):
        return b.negate(slope_product(b, slope_quotient(b, slope, divisor), quotient))
    return b.zero_with(slope, b.negate(b.multiply(b.divide(slope, divisor), quotient)))


def of_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """cos x."""
    return b.apply("cos", a[0])


def of_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """−sin x."""
    return b.negate(b.apply("sin", a[0]))


def of_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 + tan² x."""
    return one_plus_square(b, v)


def of_arc_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 / √(1 − x²)."""
    return inverse(b, b.apply("sqrt", one_minus_square(b, a[0])))


def of_arc_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """−1 / √(1 − x²)."""
    return b.negate(inverse(b, b.apply("sqrt", one_minus_square(b, a[0]))))


def of_arc_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 / (1 + x²)."""
    return inverse(b, one_plus_square(b, a[0]))


def of_hyperbolic_sine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """cosh x."""
    return b.apply("cosh", a[0])


def of_hyperbolic_cosine(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """sinh x."""
    return b.apply("sinh", a[0])


def of_hyperbolic_tangent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 − tanh² x."""
    return one_minus_square(b, v)


def of_exponential(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """eˣ."""
    return v


def of_logarithm(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 / x."""
    return inverse(b, a[0])


def of_square_root(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """1 / (2 √x)."""
    return b.divide(b.constant(0.5), v)


def of_magnitude(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """sign x; 0 at x = 0."""
    return b.apply("sign", a[0])


def of_sign(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """0; NaN where x is NaN or infinite."""
    return b.multiply(b.constant(0.0), a[0])


def of_logistic(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """σ (1 − σ)."""
    return b.multiply(v, b.subtract(b.constant(1.0), v))


def of_soft_plus(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """σ(x)."""
    return b.apply("sigmoid", a[0])


def of_angle_in_y(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ atan2(y, x) / ∂y = x / (x² + y²)."""
    return b.divide(a[1], sum_of_squares(b, a))


def of_angle_in_x(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ atan2(y, x) / ∂x = −y / (x² + y²)."""
    return b.negate(b.divide(a[0], sum_of_squares(b, a)))


def of_power_in_base(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ xᵖ / ∂x = p xᵖ⁻¹."""
    return slope_product(b, a[1], b.apply("pow", a[0], b.subtract(a[1], b.constant(1.0))))


def of_power_in_exponent(b: Arithmetic[V], a: tuple[V, ...], v: V) -> V:
    """∂ xᵖ / ∂p = xᵖ log x."""
    return slope_product(b, v, b.apply("log", a[0]))


def curvatures_of_power(b: Arithmetic[V], a: tuple[V, ...], v: V) -> tuple[V, V, V]:
    """∂²/∂x² = p (p−1) xᵖ⁻², ∂²/∂x∂p = xᵖ⁻¹ + p xᵖ⁻¹ log x, ∂²/∂p² = xᵖ log² x.

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
