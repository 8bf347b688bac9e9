"""Keeps the element of an exported estimator whose error uses the most of its tolerance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msnn.agreement.agreement import Agreement
from msnn.agreement.faults import FarStep, Fault, SelfTestFails
from msnn.agreement.judging.judgement import FloatType

Array = NDArray[np.float64]


class EstimateShare:
    """The largest part so far; a number that is NaN takes more than any other, and stays."""

    def __init__(self) -> None:
        self._share, self._worst, self._allowed = 0.0, 0.0, 0.0
        self._steps = 0

    def count(self) -> None:
        """Counts a step."""
        self._steps += 1

    def compare(self, found: Array, expected: Array, near: Array, largest: Array) -> None:
        """Takes numbers that may be off by `near`; told is what they are off by `largest`."""
        off = np.abs(found.astype(float) - expected)
        with np.errstate(all="ignore"):
            # of a number that may not be off at all every difference is too much
            parts = np.where(off == 0, 0.0, off / near)
        if parts.size == 0 or np.isnan(self._share):
            return
        most = int(np.argmax(parts))
        # written so that NaN counts as larger: argmax finds it first as well
        if not parts[most] <= self._share:
            # an estimate that is 0 all along has no magnitude to compare with
            size = max(float(largest[most]), float(np.finfo(float).tiny))
            self._share = float(parts[most])
            self._worst, self._allowed = float(off[most]) / size, float(near[most]) / size

    def agreement(
        self,
        *,
        target: str,
        dtype: FloatType,
        has_failed: bool,
        selftest: int,
        tested: str,
        untried: tuple[str, ...] = (),
    ) -> Agreement:
        """`one_step` is the worst number; steps follow each other: `free_run` is the same."""
        faults: tuple[Fault, ...] = ()
        if has_failed or not self._share <= 1:
            faults = (FarStep("the estimate", self._worst, self._allowed),)
        if selftest:
            faults = (*faults, SelfTestFails(f"the self-test of the {tested}", selftest))
        return Agreement(
            target=target,
            dtype=dtype,
            steps=self._steps,
            one_step=self._worst,
            free_run=self._worst,
            jacobian=None,
            bits=None,
            faults=faults,
            undecided={},
            untried=untried,
            rounding={},
        )
