"""Reckons with intervals of floats, whole numbers and truths, as the statements of kernels do.

Each operation is monotone in each operand, also after rounding, so the ends decide (R. E. Moore,
"Interval Analysis", 1966).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import Any, assert_never

import numpy as np

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import Function, Operator


class NotProvedError(Exception):
    """Of a box; halves of it may do."""


@dataclass(frozen=True, slots=True)
class Interval:
    """Reals of the format or whole numbers, both ends included; a truth is within 0 and 1."""

    low: Any
    high: Any
    nan: bool = False

    def __post_init__(self) -> None:
        assert self.low == self.low, self
        assert self.high == self.high, self

    @property
    def empty(self) -> bool:
        return not self.low <= self.high and not self.nan

    def join(self, other: Interval) -> Interval:
        low, high = min(self.low, other.low), max(self.high, other.high)
        return Interval(low, high, self.nan or other.nan)


def joined(first: tuple[Interval, ...], *others: tuple[Interval, ...]) -> tuple[Interval, ...]:
    return tuple(reduce(Interval.join, each) for each in zip(first, *others, strict=True))


def every(format: Format) -> Interval:
    """All numbers of a format, infinities and NaN."""
    return Interval(format.dtype.type(-np.inf), format.dtype.type(np.inf), nan=True)


def halves(one: Interval, format: Format) -> list[Interval]:
    """Cut between two binades, or within one; nothing where one number is left."""
    low, high = (ordinal(end, format) for end in (one.low, one.high))
    if low >= high:
        return []
    binade = 1 << (format.digits - 1)
    middle = (low + high + 1) // 2
    whole = middle // binade * binade
    cut = whole if low < whole <= high else middle
    below, above = number_at(cut - 1, format), number_at(cut, format)
    return [Interval(one.low, below, one.nan), Interval(above, one.high)]


def ordinal(value: Any, format: Format) -> int:
    """Which number of the format it is, counted from 0."""
    word = np.int32 if format.digits == 24 else np.int64
    bits = int(np.abs(np.asarray(value, format.dtype)).view(word))
    return -bits if value < 0 else bits


def number_at(ordinal: int, format: Format) -> Any:
    word = np.int32 if format.digits == 24 else np.int64
    size = np.asarray(abs(ordinal), word).view(format.dtype)[()]
    return -size if ordinal < 0 else size


def of_one(function: Function, one: Interval) -> Interval:
    match function:
        case Function.NEGATE:
            return Interval(-one.high, -one.low, one.nan)
        case Function.MAGNITUDE:
            ends = sorted((abs(one.low), abs(one.high)))
            inside = one.low <= 0 <= one.high
            return Interval(type(one.low)(0) if inside else ends[0], ends[1], one.nan)
        case Function.SQUARE_ROOT:
            least = max(one.low, type(one.low)(0))
            return Interval(np.sqrt(least), np.sqrt(one.high), one.nan or one.low < 0)
        case Function.NOT:
            return Interval(1 - one.high, 1 - one.low)
        case _:
            assert_never(function)


def compared(operator: Operator, left: Interval, right: Interval) -> Interval:
    if operator in (Operator.GREATER, Operator.GREATER_EQUAL):
        left, right = right, left
    if operator in (Operator.LESS, Operator.GREATER):
        always, sometimes = left.high < right.low, left.low < right.high
    else:
        always, sometimes = left.high <= right.low, left.low <= right.high
    return Interval(int(always and not (left.nan or right.nan)), int(sometimes))


def of_reals(operator: Operator, left: Interval, right: Interval, top: Interval) -> Interval:
    if operator is Operator.DIVIDE and right.low <= 0 <= right.high:
        return top
    pairs = product((left.low, left.high), (right.low, right.high))
    match operator:
        case Operator.ADD:
            ends = [left.low + right.low, left.high + right.high]
        case Operator.SUBTRACT:
            ends = [left.low - right.high, left.high - right.low]
        case Operator.MULTIPLY:
            ends = [one * other for one, other in pairs]
            unbounded = (np.isinf(one.low) or np.isinf(one.high) for one in (left, right))
            if any(unbounded) and any(one.low <= 0 <= one.high for one in (left, right)):
                return top
        case Operator.DIVIDE:
            ends = [one / other for one, other in pairs]
        case _:
            raise AssertionError(operator)
    if any(np.isnan(end) for end in ends) or _opposite_infinities(operator, left, right):
        return top
    return Interval(min(ends), max(ends), left.nan or right.nan)


def _opposite_infinities(operator: Operator, left: Interval, right: Interval) -> bool:
    """Whether a sum or a difference may be NaN though that of the ends is not."""
    return operator in (Operator.ADD, Operator.SUBTRACT) and any(
        np.isinf(one) and np.isinf(other)
        for one, other in product((left.low, left.high), (right.low, right.high))
    )


def of_whole_numbers(operator: Operator, left: Interval, right: Interval, bits: int) -> Interval:
    """Modulo 2^bits; all of them where the ends do not decide."""
    top = Interval(0, 2**bits - 1)
    match operator:
        case Operator.ADD:
            found = Interval(left.low + right.low, left.high + right.high)
        case Operator.SUBTRACT:
            found = Interval(left.low - right.high, left.high - right.low)
        case Operator.MULTIPLY:
            found = Interval(left.low * right.low, left.high * right.high)
        case Operator.SHIFT_LEFT | Operator.SHIFT_RIGHT:
            if right.high >= bits:
                raise NotProvedError(f"{bits} bits are shifted by {right}")
            left_ends = left.low << right.low, left.high << right.high
            right_ends = left.low >> right.high, left.high >> right.low
            found = Interval(*(left_ends if operator is Operator.SHIFT_LEFT else right_ends))
        case Operator.BITS_AND:
            found = Interval(0, min(left.high, right.high))
        case _:
            found = top
    return found if top.low <= found.low and found.high <= top.high else top
