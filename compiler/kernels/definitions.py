"""Scalar functions in terms of others, for backends without an exact one, and parts of slopes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compiler.ir.builder import GraphBuilder
    from compiler.ir.program import NodeId

    Arguments = tuple[NodeId, ...]


def tangent(b: GraphBuilder, a: Arguments) -> NodeId:
    """sin / cos."""
    return b.divide(b.apply("sin", a[0]), b.apply("cos", a[0]))


def hyperbolic_sine(b: GraphBuilder, a: Arguments) -> NodeId:
    """tanh · cosh: tanh keeps the small arguments that eˣ − e⁻ˣ cancels; cosh ≥ 1 loses nothing."""
    return b.multiply(b.apply("tanh", a[0]), b.apply("cosh", a[0]))


def hyperbolic_cosine(b: GraphBuilder, a: Arguments) -> NodeId:
    """e^|x| / 2 + 1 / (2 e^|x|)."""
    grown = b.apply("exp", b.apply("abs", a[0]))
    half = b.constant(0.5)
    return b.add(b.multiply(half, grown), b.divide(half, grown))


def logistic(b: GraphBuilder, a: Arguments) -> NodeId:
    """1 / (1 + e⁻ˣ); beyond the bound the sum rounds to eˣ anyway, and exp = ∞ has slope 0 · ∞."""
    grown = b.apply("exp", b.minimum(b.negate(a[0]), b.constant(700.0)))
    return b.divide(b.constant(1.0), b.add(b.constant(1.0), grown))


def soft_plus(b: GraphBuilder, a: Arguments) -> NodeId:
    """max(x, 0) + log(1 + e^−|x|).

    A tie has the slope of the first operand: half of each order gives the right one at 0, 1/2.
    """
    zero, half = b.constant(0.0), b.constant(0.5)
    both = b.add(b.maximum(a[0], zero), b.maximum(zero, a[0]))
    tail = b.apply("exp", b.negate(b.apply("abs", a[0])))
    return b.add(b.multiply(half, both), b.apply("log", b.add(b.constant(1.0), tail)))


def by_kernel(name: str) -> Callable[[GraphBuilder, Arguments], NodeId]:
    """The project's kernel of that name as core operations."""

    def definition(b: GraphBuilder, a: Arguments) -> NodeId:
        # the kernels are large and most programs need none of them as operations
        from compiler.kernels.expand import expand_kernel

        return expand_kernel(b, name, a)

    return definition


def one_minus_square(b: GraphBuilder, value: NodeId) -> NodeId:
    """1 − v²."""
    return b.subtract(b.constant(1.0), b.multiply(value, value))


def one_plus_square(b: GraphBuilder, value: NodeId) -> NodeId:
    """1 + v²."""
    return b.add(b.constant(1.0), b.multiply(value, value))


def inverse(b: GraphBuilder, value: NodeId) -> NodeId:
    """1 / v."""
    return b.divide(b.constant(1.0), value)


def sum_of_squares(b: GraphBuilder, a: Arguments) -> NodeId:
    """a₀² + a₁²."""
    return b.add(b.multiply(a[0], a[0]), b.multiply(a[1], a[1]))


def slope_product(b: GraphBuilder, first: NodeId, second: NodeId) -> NodeId:
    """The product of two factors of a derivative: 0 where a factor is 0, whatever the other is.

    A factor is tested only where the other one can be infinite (or NaN, as 0/0 is).
    """
    product = b.multiply(first, second)
    if b.infinite_values.can_be_infinite(first):
        product = zero_with(b, second, product)
    if b.infinite_values.can_be_infinite(second):
        product = zero_with(b, first, product)
    return product


def slope_quotient(b: GraphBuilder, slope: NodeId, divisor: NodeId) -> NodeId:
    """slope · 1/divisor by the same rule."""
    quotient = b.divide(slope, divisor)
    if b.infinite_values.divides(divisor):
        return quotient
    return zero_with(b, slope, quotient)


def divisor_slope(b: GraphBuilder, slope: NodeId, divisor: NodeId, quotient: NodeId) -> NodeId:
    """slope · −quotient/divisor by the same rule; the slope is looked at once."""
    if b.infinite_values.can_be_infinite(slope) or b.infinite_values.divides(divisor):
        return b.negate(slope_product(b, slope_quotient(b, slope, divisor), quotient))
    return zero_with(b, slope, b.negate(b.multiply(b.divide(slope, divisor), quotient)))


def zero_with(b: GraphBuilder, factor: NodeId, product: NodeId) -> NodeId:
    """0 where the factor is 0, else the product; a factor that is NaN is not 0."""
    from compiler.ir.ops import Relation

    if b.infinite_values.is_never_zero(factor):
        return product
    is_zero = b.compare(Relation.LESS_EQUAL, b.apply("abs", factor), b.constant(0.0))
    zero = b.broadcast(b.constant(0.0), b.type(product).axes)
    return b.select(is_zero, zero, product)
