"""Defines the derivatives of scalar functions, from their arguments `a` and their value `v`."""

from __future__ import annotations

from compiler.ir.scalars.arithmetic import Arithmetic, V
from compiler.ir.scalars.formulas import (
    inverse,
    one_minus_square,
    one_plus_square,
    sum_of_squares,
)
from compiler.ir.scalars.slope_products import slope_product


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
