"""Holds the measurements and inputs of a window of samples, as references of its problem."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from compiler.ir.types import Type
from msnn.features.control.problem.moving_horizon.window_problem import (
    RUNS,
    SPREAD,
    STARTS,
    WindowProblem,
)
from msnn.features.control.problem.optimal_control.horizon import Array


class WindowData:
    """The newest sample is the last of each reference; the window grows until it is full."""

    def __init__(self, window: WindowProblem) -> None:
        self._window = window
        self._last = window.control.horizon
        self.count = 0
        """Steps from the window's first sample to its newest."""
        self.references: dict[str, Array] = {}
        for member in window.control.references.members:
            rows = self._last + 1 if member.name in window.control.previewed else 1
            self.references[member.name] = np.zeros((rows, *Type(member.axes).shape))
        self._is_given = False

    @property
    def is_full(self) -> bool:
        return self.count == self._last - 1

    @property
    def first(self) -> int:
        """The stage of the window's first sample."""
        return self._last - self.count

    def measure(self, measured: Mapping[str, Array]) -> None:
        """Stores the measurements of the newest sample; NaN marks missing ones."""
        for signal, value in measured.items():
            seen = ~np.isnan(value)
            kept = self.references[self._window.measured(signal)]
            # a number that is measured twice keeps the newer value
            kept[-1] = np.where(seen, value, kept[-1])
            marks = self.references[self._window.seen(signal)]
            marks[-1] = np.where(seen, 1.0, marks[-1])

    def fresh(self, measured: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """The values not yet measured at the newest sample; NaN stands for the rest."""
        found = {name: np.asarray(value, float) for name, value in measured.items()}
        for name, value in found.items():
            marks = self.references.get(self._window.seen(name))
            # names and shapes that are wrong, and what is infinite, are for the filter to refuse
            if marks is not None and marks[-1].shape == value.shape:
                found[name] = np.where((marks[-1] > 0) & np.isfinite(value), np.nan, value)
        return found

    def give(self, inputs: Mapping[str, Array]) -> None:
        """Stores inputs of the newest sample; the first ones count for all earlier samples too."""
        for name, value in inputs.items():
            kept = self.references[self._window.inputs[name]]
            # stages before the window's first sample are evaluated too, and need inputs that are
            # finite
            kept[-1 if self._is_given else slice(None)] = value
        self._is_given = self._is_given or bool(inputs)

    def samples_at(self, stage: int) -> tuple[dict[str, Array], dict[str, Array]]:
        """The measurements at a stage, NaN where nothing was measured, and its inputs."""
        measured: dict[str, Array] = {}
        for name in self._window.signals:
            seen = self.references[self._window.seen(name)][stage] > 0
            value = self.references[self._window.measured(name)][stage]
            measured[name] = np.where(seen, value, np.nan)
        known = self._window.inputs.items()
        return measured, {name: self.references[own][stage] for name, own in known}

    def advance(self) -> None:
        """Moves the window by one sample, which has no measurements yet and the previous inputs."""
        # previewed references are the samples; the others are of the whole window
        for name, values in self.references.items():
            if name in self._window.control.previewed:
                values[:-1] = values[1:].copy()
        for name in self._window.signals:
            self.references[self._window.measured(name)][-1] = 0.0
            self.references[self._window.seen(name)][-1] = 0.0
        # once full, the window keeps its length and moves
        self.count = min(self.count + 1, self._last - 1)

    def begin(self, spread: Array) -> None:
        """Sets the state and the covariance with which the window begins."""
        stages = np.arange(self._last + 1)
        # ξ_0 = x̄ + S v is the step from the stage before the first sample
        self.references[STARTS][:] = stages == self.first - 1
        self.references[RUNS][:] = stages >= self.first
        self.references[SPREAD][0] = spread
