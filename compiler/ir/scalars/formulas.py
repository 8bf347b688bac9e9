"""Defines scalar functions by formulas of others, and common terms of their derivatives."""

from __future__ import annotations

from compiler.ir.scalars.arithmetic import Arithmetic, V


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
