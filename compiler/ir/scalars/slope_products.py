"""Multiplies the factors of derivatives: a product with a factor 0 is 0, whatever the other is.

See decisions/0184.
"""

from __future__ import annotations

from compiler.ir.scalars.arithmetic import Arithmetic, V

LARGEST_SLOPE = 1e20
"""Training takes what is larger, or NaN, for infinite where a slope can be so. It lies below what
stands for an infinite slope in libraries that differentiate by themselves."""


def slope_product(b: Arithmetic[V], first: V, second: V) -> V:
    """The product of two factors of a derivative: 0 where a factor is 0, whatever the other is.

    A factor is tested only where the other one can be infinite (or NaN, as 0/0 is).
    """
    product = b.multiply(first, second)
    if b.infinite_values.can_be_infinite(first):
        product = b.zero_with(second, product)
    if b.infinite_values.can_be_infinite(second):
        product = b.zero_with(first, product)
    return product


def slope_quotient(b: Arithmetic[V], slope: V, divisor: V) -> V:
    """slope · 1/divisor by the same rule."""
    quotient = b.divide(slope, divisor)
    if b.infinite_values.divides(divisor):
        return quotient
    return b.zero_with(slope, quotient)


def divisor_slope(b: Arithmetic[V], slope: V, divisor: V, quotient: V) -> V:
    """slope · −quotient/divisor by the same rule; the slope is looked at once."""
    if b.infinite_values.can_be_infinite(slope) or b.infinite_values.divides(divisor):
        return b.negate(slope_product(b, slope_quotient(b, slope, divisor), quotient))
    return b.zero_with(slope, b.negate(b.multiply(b.divide(slope, divisor), quotient)))
