"""Writes scalar functions in terms of others, and the parts that slopes share."""

from __future__ import annotations

from compiler.ir.scalars.arithmetic import Arithmetic, V


def tangent(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """sin / cos."""
    return b.divide(b.apply("sin", a[0]), b.apply("cos", a[0]))


def hyperbolic_sine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """tanh · cosh: tanh keeps the small arguments that eˣ − e⁻ˣ cancels; cosh ≥ 1 loses nothing."""
    return b.multiply(b.apply("tanh", a[0]), b.apply("cosh", a[0]))


def hyperbolic_cosine(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """e^|x| / 2 + 1 / (2 e^|x|)."""
    grown = b.apply("exp", b.apply("abs", a[0]))
    half = b.constant(0.5)
    return b.add(b.multiply(half, grown), b.divide(half, grown))


def logistic(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """1 / (1 + e⁻ˣ); beyond the bound the sum rounds to eˣ anyway, and exp = ∞ has slope 0 · ∞."""
    grown = b.apply("exp", b.minimum(b.negate(a[0]), b.constant(700.0)))
    return b.divide(b.constant(1.0), b.add(b.constant(1.0), grown))


def soft_plus(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """max(x, 0) + log(1 + e^−|x|).

    A tie has the slope of the first operand: half of each order gives the right one at 0, 1/2.
    """
    zero, half = b.constant(0.0), b.constant(0.5)
    both = b.add(b.maximum(a[0], zero), b.maximum(zero, a[0]))
    tail = b.apply("exp", b.negate(b.apply("abs", a[0])))
    return b.add(b.multiply(half, both), b.apply("log", b.add(b.constant(1.0), tail)))


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
