"""Values with bounds on their rounding error, and the rules for operations that only move or select
elements. `rounding.py` has the rules for arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, Evaluator


@dataclass(frozen=True, slots=True)
class Bounded:
    """A value with a bound on its rounding error; it is a sum of `count` terms, which a program may
    add in any order.

    Arrays are (members, *shape); the first axis is 1 if the value is the same for all members. For
    bools, `error` is 1 where another program may decide differently.
    """

    value: Array
    error: Array
    """Sum of the maximum errors of the terms, in float64."""
    terms: Array
    """Sum of the magnitudes of the terms, in float64."""
    count: int

    def spread(self, unit: float) -> Array:
        """Maximum rounding error of each element, for any order of summation; `unit` is the unit
        roundoff.
        """
        # a sum of n terms in any order has n − 1 roundings, each at most u Σ|terms|
        return self.error + (self.count - 1) * unit * self.terms if self.count > 1 else self.error

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        return self.value, self.error, self.terms

    def repeated(self, members: int) -> Bounded:
        """The same value and bounds for each of `members` members; only valid if the first axis is
        1 or `members`.
        """
        value, error, terms = (
            np.broadcast_to(part, (members, *part.shape[1:])) for part in self.parts
        )
        return Bounded(value, error, terms, self.count)


@dataclass(frozen=True, slots=True)
class Taken:
    """Prescribed outcomes of a decision (a comparison or sign): `value` where `where` is True, the
    own outcome elsewhere. Both arrays are (members, *shape).
    """

    where: Array
    value: Array

    def instead_of(self, one: Bounded) -> Bounded:
        """The decision `one` after the prescribed outcomes have replaced its own; the prescribed
        ones have no rounding error.
        """
        value = np.where(self.where, self.value, one.value).astype(one.value.dtype)
        error = np.where(self.where, 0.0, one.error)
        # prescribed elements are exact: their terms are their magnitude
        return Bounded(value, error, np.where(self.where, abs(self.value), one.terms), one.count)


def exact(value: Array) -> Bounded:
    """The value as one without rounding error: every program computes the same bits of it."""
    size = value if value.dtype == bool else np.abs(value)
    return Bounded(value, np.zeros(value.shape), size.astype(float), 1)


def unit_roundoff(dtype: np.dtype[Any]) -> float:
    """The unit roundoff u of float32 or float64: the maximum relative error of a correctly rounded
    result, with 1 % added for terms in u².
    """
    return 0.5 * 1.01 * float(np.finfo(dtype).eps)


def moved(meaning: Evaluator, args: Sequence[Bounded]) -> Bounded:
    """The result, with bounds, of an operation that only moves elements or negates them. `meaning`
    evaluates the operation, `args` are its operands.
    """
    value = meaning([one.value for one in args], NOWHERE)
    # a negation also negates the bounds
    error = np.abs(meaning([one.error for one in args], NOWHERE))
    terms = np.abs(meaning([one.terms for one in args], NOWHERE))
    # parts of a concatenation may be sums of different lengths: the longest bounds all
    return Bounded(value, error, terms, max(one.count for one in args))


def pushed(meaning: Evaluator, newest: Bounded, state: str, past: Bounded) -> Bounded:
    """The result of `Window` with bounds: the samples `past` of the buffer `state`, followed by the
    sample `newest`. `meaning` evaluates the operation.
    """
    value, error, terms = (
        meaning([part], replace(NOWHERE, states={state: before}))
        # bounds move along the buffer like values
        for part, before in zip(newest.parts, past.parts, strict=True)
    )
    return Bounded(value, error, terms, max(newest.count, past.count))


def selected(args: Sequence[Bounded], spreads: Sequence[Array]) -> Bounded:
    """The result of `Select` with bounds. `args` are condition, then, otherwise; `spreads` are
    their maximum rounding errors (`Bounded.spread`).
    """
    condition, then, otherwise = args
    value = np.where(condition.value, then.value, otherwise.value)
    decided = np.where(condition.value, spreads[1], spreads[2])
    apart = np.abs(then.value.astype(float) - otherwise.value.astype(float))
    # if the condition may differ, the other value may be selected, with its own error
    either = np.maximum(spreads[1], spreads[2]) + apart
    return chosen(value, np.where(condition.error > 0, either, decided))


def chosen(value: Array, error: Array) -> Bounded:
    """The result of an operation that selects one of several values, with the rounding bound
    `error` for each element.

    An infinite value may have the bound 0. A NaN bound becomes infinite.
    """
    error = np.where(np.isnan(error), np.inf, error)
    return Bounded(value, error, np.abs(value.astype(float)) + error, 1)


@dataclass(slots=True)
class Total:
    """A sum over all members and steps, in float64, with the sums from which its rounding bound
    follows.

    The bound holds for programs of precision `dtype` that add in any order.
    """

    dtype: np.dtype[Any]
    """Precision of the program whose sum is bounded."""
    value: Any = 0.0
    error: Any = 0.0
    terms: Any = 0.0
    count: int = 0

    def add(self, one: Bounded) -> None:
        """Adds the values of all members in one step."""
        with np.errstate(all="ignore"):
            # always in float64: `off` adds the rounding of the program
            self.value = self.value + one.value.astype(float).sum(axis=0)
            self.error = self.error + one.error.sum(axis=0)
            self.terms = self.terms + one.terms.sum(axis=0)
        # each member adds as many terms as its value has
        self.count += one.count * len(one.value)

    def off(self) -> Array:
        """Maximum rounding error of each element of the sum; infinite if a partial sum in another
        order may overflow.
        """
        off = self.error + max(self.count - 1, 0) * unit_roundoff(self.dtype) * self.terms
        # partial sums in another order may overflow: then there is no bound
        known = self.terms + off < 0.5 * float(np.finfo(self.dtype).max)
        return np.where(known, off, np.inf)


@dataclass(slots=True)
class AdjointTape:
    """The adjoints ∂S/∂(state) of one state during the backward loop, with rounding bounds. For a
    buffer it holds those of every sample of the rollout.
    """

    dtype: np.dtype[Any]
    length: int | None
    """Number of samples in the buffer; None for a state without window."""
    value: Array
    error: Array
    terms: Array
    count: int = 1

    @classmethod
    def of_zeros(
        cls, members: int, shape: tuple[int, ...], steps: int | None, dtype: np.dtype[Any]
    ) -> AdjointTape:
        """The adjoints after the last step, all 0, for this number of members.

        `shape` is that of the state. `steps` is the length of the rollouts for a buffer, None for a
        state that is no buffer.
        """
        # the samples before the run, and one per step
        whole = shape if steps is None else (*shape[:-1], shape[-1] + steps)
        value, error, terms = np.zeros((3, members, *whole))
        return cls(dtype, None if steps is None else shape[-1], value, error, terms)

    def after(self, number: int) -> Bounded:
        """The adjoint of the result of step `number`, counted from 0: of the state's next value, or
        of the sample that the step appends to a buffer.
        """
        if self.length is None:
            return self._part(...)
        # after step `number` this is the last sample of the buffer
        return self._part((..., number + self.length))

    def go_back(self, number: int, found: Bounded | None) -> None:
        """Replaces the adjoints after step `number` by those before it.

        `found` is the adjoint that the reverse step computed for the state; None if the step does
        not read it. Adjoints of a buffer's samples add up over the steps that read them.
        """
        if self.length is None:
            shape = self.value.shape
            # the step does not use the state: its adjoint is 0
            parts = (np.zeros(shape),) * 3 if found is None else found.parts
            self.value, self.error, self.terms = (np.asarray(part, float) for part in parts)
            self.count = 1 if found is None else found.count
        elif found is not None:
            # the samples in the buffer before the step; several steps add to the same samples
            samples = (..., slice(number, number + self.length))
            with np.errstate(all="ignore"):
                self.value[samples] += found.value
                self.error[samples] += found.error
                self.terms[samples] += found.terms
            self.count += found.count

    def at_start(self) -> Bounded:
        """The adjoint of the state at t0, before the first step."""
        return self._part(... if self.length is None else (..., slice(0, self.length)))

    def _part(self, where: Any) -> Bounded:
        value = self.value[where].astype(self.dtype)
        return Bounded(value, self.error[where], self.terms[where], self.count)
