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
    """e^−|x| / (1 + e^−|x|) below 0, else 1 / (1 + e^−|x|): no intermediate overflows.

    e⁻ˣ of a large −x would, and its square in the derivative from half of that on.
    """
    one, tail = b.constant(1.0), _tail(b, a[0])
    return b.divide(b.where_negative(a[0], tail, one), b.add(one, tail))


def soft_plus(b: Arithmetic[V], a: tuple[V, ...]) -> V:
    """max(x, 0) + log(1 + e^−|x|)."""
    one, tail = b.constant(1.0), _tail(b, a[0])
    whole = b.add(one, tail)
    # what the sum rounds off: to first order of it log(w + r) = log w + r/w, all digits of the tail
    rest = b.subtract(tail, b.subtract(whole, one))
    logarithm = b.add(b.apply("log", whole), b.divide(rest, whole))
    return b.add(b.where_negative(a[0], b.constant(0.0), a[0]), logarithm)


def _tail(b: Arithmetic[V], x: V) -> V:
    """e^−|x|, by choice of −x or x: |x| has the derivative 0 at 0, where both functions rise."""
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
