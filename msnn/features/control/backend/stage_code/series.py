"""Lays the plan of a condensed controller out as series, one for each number, in order of time.

The number of a state or a control has a series s[−past] … s[N]. A stage k reads s[k − lag], at the
place of lag behind its own beginning k, so that its windows are parts of the series.
"""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.places import c_strides
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.window_form import Sample, WindowForm


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a quantity: element (i, j, …) at first + Σ stride · index of an array."""

    array: str
    first: int
    strides: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Series:
    """The beginning of each series; those of states come first, then those of controls."""

    form: WindowForm
    horizon: int
    firsts: tuple[int, ...]
    now: tuple[int, ...]
    """Where the sample of k = 0 is in each."""
    size: int

    def place(self, sample: Sample) -> int:
        """The place of a sample in its series."""
        # that of stage 0: stage k adds k, whatever the sample
        return self.now[self._number(sample)] - sample.lag

    @property
    def lasts(self) -> tuple[int, ...]:
        """The last sample that a shift replaces: of controls the one before the last decided."""
        n, states = self.horizon, self.form.states
        return tuple(at + n - (number >= states) for number, at in enumerate(self.now))

    def of_memory(self) -> tuple[int, ...]:
        """The place of each number of x."""
        return tuple(self.place(sample) for sample in self.form.memory)

    def control(self, number: int) -> int:
        """The place of a control."""
        return self.now[self.form.states + number]

    def _number(self, sample: Sample) -> int:
        return sample.number + (self.form.states if sample.is_control else 0)


def series_of(problem: ControlProblem, form: WindowForm) -> Series:
    """The series of a problem."""
    count = form.states + problem.controls.size
    past = [0] * count
    for sample in form.memory:
        number = sample.number + (form.states if sample.is_control else 0)
        past[number] = max(past[number], sample.lag)
    # as many samples of the past as the longest lag reads
    lengths = [length + problem.horizon + 1 for length in past]
    firsts = tuple(sum(lengths[:number]) for number in range(count))
    now = tuple(first + length for first, length in zip(firsts, past, strict=True))
    return Series(form, problem.horizon, firsts, now, sum(lengths))


def places_in_series(problem: ControlProblem, series: Series) -> dict[str, Place]:
    """The places of states and controls as a stage finds them."""
    at = series.of_memory()
    found: dict[str, Place] = {}
    for member in problem.states.members:
        found[member.name] = _place(Type(member.axes).shape, at[member.first :])
    for member in problem.controls.members:
        numbers = range(member.first, member.first + member.size)
        found[member.name] = _place(Type(member.axes).shape, [series.control(i) for i in numbers])
    return found


def _place(shape: tuple[int, ...], at: tuple[int, ...] | list[int]) -> Place:
    """The place of a quantity whose numbers, in C order, stand at these places."""
    steps = c_strides(shape)
    # buffers keep whole signals: the numbers of one have series of one length, and one stride
    strides = tuple(
        at[step] - at[0] if size > 1 else 0 for size, step in zip(shape, steps, strict=True)
    )
    return Place("z", at[0], strides)
