"""Lays the plan of a condensed controller out as time series, one per scalar state or control.

A scalar has the series s[−L] … s[N] over the horizon N, where L is its longest lag. Stage k reads
s[k − lag]; a window of past samples is a contiguous part of the series, so nothing is copied.
"""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.places import c_strides
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.window_form import Sample, WindowForm


@dataclass(frozen=True, slots=True)
class Place:
    """The location of a quantity: element (i, j, …) is array element first + Σ stride · index."""

    array: str
    first: int
    strides: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Series:
    """The layout of all series in one array `z`: those of states first, then those of controls."""

    form: WindowForm
    horizon: int
    firsts: tuple[int, ...]
    """The array index of the oldest sample of each series."""
    now: tuple[int, ...]
    """The array index of the sample at stage 0 of each series."""
    size: int
    """The number of samples of all series together."""

    def place(self, sample: Sample) -> int:
        """Returns the array index of a sample that stage 0 reads; for stage k add k."""
        return self.now[self._number(sample)] - sample.lag

    @property
    def lasts(self) -> tuple[int, ...]:
        """The array index of sample N of each state and of sample N − 1, the last, of each control.

        Shifting the plan by one sample copies z[j + 1] to z[j] for all earlier j of the series.
        """
        n, states = self.horizon, self.form.states
        return tuple(at + n - (number >= states) for number, at in enumerate(self.now))

    def of_memory(self) -> tuple[int, ...]:
        """Returns the array index at stage 0 of each element of x."""
        return tuple(self.place(sample) for sample in self.form.memory)

    def control(self, number: int) -> int:
        """Returns the array index at stage 0 of element `number` of u."""
        return self.now[self.form.states + number]

    def _number(self, sample: Sample) -> int:
        """Returns the index of the series of a sample."""
        return sample.number + (self.form.states if sample.is_control else 0)


def series_of(problem: ControlProblem, form: WindowForm) -> Series:
    """Computes the layout of the series of a problem in window form."""
    count = form.states + problem.controls.size
    past = [0] * count
    for sample in form.memory:
        number = sample.number + (form.states if sample.is_control else 0)
        past[number] = max(past[number], sample.lag)
    # past samples up to the longest lag, then the samples of stages 0 … N
    lengths = [length + problem.horizon + 1 for length in past]
    firsts = tuple(sum(lengths[:number]) for number in range(count))
    now = tuple(first + length for first, length in zip(firsts, past, strict=True))
    return Series(form, problem.horizon, firsts, now, sum(lengths))


def places_in_series(problem: ControlProblem, series: Series) -> dict[str, Place]:
    """Returns the place of each state and control at stage 0, by name."""
    at = series.of_memory()
    places: dict[str, Place] = {}
    for member in problem.states.members:
        places[member.name] = _place(Type(member.axes).shape, at[member.first :])
    for member in problem.controls.members:
        numbers = range(member.first, member.first + member.size)
        places[member.name] = _place(Type(member.axes).shape, [series.control(i) for i in numbers])
    return places


def _place(shape: tuple[int, ...], at: tuple[int, ...] | list[int]) -> Place:
    """Returns the place of a quantity from the array indices of its elements in C order."""
    steps = c_strides(shape)
    # the elements of one signal have series of equal length, so that one stride per axis suffices
    strides = tuple(
        at[step] - at[0] if size > 1 else 0 for size, step in zip(shape, steps, strict=True)
    )
    return Place("z", at[0], strides)
