"""Multiplies factors of derivatives: 0 times any factor is 0, also times infinity.

See decision 0184.
"""

from __future__ import annotations

from compiler.ir.scalars.arithmetic import Arithmetic, V

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
    """derivative · 1/divisor, 0 where the derivative is 0."""
    quotient = b.divide(slope, divisor)
    if b.infinite_values.divides(divisor):
        return quotient
    return b.zero_with(slope, quotient)


def divisor_slope(b: Arithmetic[V], slope: V, divisor: V, quotient: V) -> V:
    """derivative · −quotient/divisor, 0 where the derivative is 0; it is tested only once."""
    if b.infinite_values.can_be_infinite(slope) or b.infinite_values.divides(divisor):
        return b.negate(slope_product(b, slope_quotient(b, slope, divisor), quotient))
    return b.zero_with(slope, b.negate(b.multiply(b.divide(slope, divisor), quotient)))
