"""Values with bounds on their rounding error, and the operations that only move or select."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, Evaluator


@dataclass(frozen=True, slots=True)
class Bounded:
    """A value with a bound on its rounding error; it is a sum of `count` terms in any order.

    Arrays are (members, *shape); the batch is 1 if members do not differ. For bools, `error` is 1
    where another program may decide differently.
    """

    value: Array
    error: Array
    """Σ of the errors of the terms, in float64."""
    terms: Array
    """Σ|terms|, in float64."""
    count: int

    def spread(self, unit: float) -> Array:
        """Maximum error of the value in any such program, compared with the exact value."""
        # a sum of n terms in any order has n − 1 roundings, each at most u Σ|terms|
        return self.error + (self.count - 1) * unit * self.terms if self.count > 1 else self.error

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        return self.value, self.error, self.terms

    def repeated(self, members: int) -> Bounded:
        """The same value for each of `members` members."""
        value, error, terms = (
            np.broadcast_to(part, (members, *part.shape[1:])) for part in self.parts
        )
        return Bounded(value, error, terms, self.count)


@dataclass(frozen=True, slots=True)
class Taken:
    """Elements of a decision that are prescribed, (members, *shape)."""

    where: Array
    value: Array

    def instead_of(self, one: Bounded) -> Bounded:
        """The decision with the prescribed elements, which have no error."""
        value = np.where(self.where, self.value, one.value).astype(one.value.dtype)
        error = np.where(self.where, 0.0, one.error)
        # prescribed elements are exact: their terms are their magnitude
        return Bounded(value, error, np.where(self.where, abs(self.value), one.terms), one.count)


def exact(value: Array) -> Bounded:
    """A value that is equal to the bit in every program."""
    size = value if value.dtype == bool else np.abs(value)
    return Bounded(value, np.zeros(value.shape), size.astype(float), 1)


def unit_roundoff(dtype: np.dtype[Any]) -> float:
    """u: the maximum relative error of a correctly rounded result, with 1 % added for terms in
    u².
    """
    return 0.5 * 1.01 * float(np.finfo(dtype).eps)


def moved(meaning: Evaluator, args: Sequence[Bounded]) -> Bounded:
    """The same elements at other positions or with the other sign."""
    value = meaning([one.value for one in args], NOWHERE)
    # a negation also negates the bounds
    error = np.abs(meaning([one.error for one in args], NOWHERE))
    terms = np.abs(meaning([one.terms for one in args], NOWHERE))
    # parts of a concatenation may be sums of different lengths: the longest bounds all
    return Bounded(value, error, terms, max(one.count for one in args))


def pushed(meaning: Evaluator, newest: Bounded, state: str, past: Bounded) -> Bounded:
    """The samples of a buffer followed by its newest sample."""
    value, error, terms = (
        meaning([part], replace(NOWHERE, states={state: before}))
        # bounds move along the buffer like values
        for part, before in zip(newest.parts, past.parts, strict=True)
    )
    return Bounded(value, error, terms, max(newest.count, past.count))


def selected(args: Sequence[Bounded], spreads: Sequence[Array]) -> Bounded:
    """`Select` with bounds."""
    condition, then, otherwise = args
    value = np.where(condition.value, then.value, otherwise.value)
    decided = np.where(condition.value, spreads[1], spreads[2])
    apart = np.abs(then.value.astype(float) - otherwise.value.astype(float))
    # if the condition may differ, the other value may be selected, with its own error
    either = np.maximum(spreads[1], spreads[2]) + apart
    return chosen(value, np.where(condition.error > 0, either, decided))


def chosen(value: Array, error: Array) -> Bounded:
    """One of several values; an infinite value may be exact."""
    error = np.where(np.isnan(error), np.inf, error)
    return Bounded(value, error, np.abs(value.astype(float)) + error, 1)
