"""Sums values with rounding bounds: totals over rollouts, and adjoints along a buffer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.interpreter.bounded import Bounded, unit_roundoff
from compiler.interpreter.operations import Array


@dataclass(slots=True)
class Total:
    """A sum over members and steps, in float64. Another program may add in any order."""

    dtype: np.dtype[Any]
    """Precision of the program whose sum is bounded."""
    value: Any = 0.0
    error: Any = 0.0
    terms: Any = 0.0
    count: int = 0

    def add(self, one: Bounded) -> None:
        """Adds a value of all members."""
        with np.errstate(all="ignore"):
            # always in float64: `off` adds the rounding of the program
            self.value = self.value + one.value.astype(float).sum(axis=0)
            self.error = self.error + one.error.sum(axis=0)
            self.terms = self.terms + one.terms.sum(axis=0)
        # each member adds as many terms as its value has
        self.count += one.count * len(one.value)

    def off(self) -> Array:
        """Maximum error of the sum in any such program, compared with the exact sum."""
        off = self.error + max(self.count - 1, 0) * unit_roundoff(self.dtype) * self.terms
        # partial sums in another order may overflow: then there is no bound
        known = self.terms + off < 0.5 * float(np.finfo(self.dtype).max)
        return np.where(known, off, np.inf)


@dataclass(slots=True)
class AdjointTape:
    """The adjoints of one state over the steps; for a buffer, of each sample."""

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
        """Zero adjoints after the last step; `steps` is the length of the rollouts, None unless
        a buffer.
        """
        # the samples before the run, and one per step
        whole = shape if steps is None else (*shape[:-1], shape[-1] + steps)
        value, error, terms = np.zeros((3, members, *whole))
        return cls(dtype, None if steps is None else shape[-1], value, error, terms)

    def after(self, number: int) -> Bounded:
        """The adjoint of the result of step `number`: the next value, or the newest sample of a
        buffer.
        """
        if self.length is None:
            return self._part(...)
        # after step `number` this is the last sample of the buffer
        return self._part((..., number + self.length))

    def go_back(self, number: int, found: Bounded | None) -> None:
        """Propagates adjoints backwards through step `number`; `found` is the adjoint of its
        state.
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
        """The adjoint of the state at t0."""
        return self._part(... if self.length is None else (..., slice(0, self.length)))

    def _part(self, where: Any) -> Bounded:
        value = self.value[where].astype(self.dtype)
        return Bounded(value, self.error[where], self.terms[where], self.count)
