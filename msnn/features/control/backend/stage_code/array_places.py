"""Maps matrix entries, and the plan of a condensed controller, to arrays of the solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.tree import Name
from backends.c_lowering.values import Value, sliced
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix, MatrixBlock
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Sample, WindowForm

NOWHERE = -1
"""The array index of a matrix entry that the array does not hold."""


@dataclass(frozen=True, slots=True)
class PlacedMatrix:
    """A matrix and the layout of the flat C array that holds some of its rows and columns.

    Entry (i, j) is array element rows[i] + columns[j].
    """

    array: str
    matrix: Matrix
    rows: NDArray[np.int64]
    """The array index at which each row begins; NOWHERE for a row that the array does not hold."""
    columns: NDArray[np.int64]
    """The offset of each column in a row; NOWHERE for a column that the array does not hold."""
    first: int
    """First array index of the part `first` … `last` − 1 that the rows fill.

    Generated C sets this part to 0 before it writes the other entries.
    """
    last: int
    takes_zeros: bool = True
    """True if a block of computed entries also stores those of its entries that are constant."""

    def known(self) -> dict[int, float]:
        """Returns the constant entries other than 0, by array index."""
        constants: dict[int, float] = {}
        for entry, number in enumerate(self.matrix.known):
            if number:
                row, column = divmod(entry, self.matrix.shape[1])
                if self.rows[row] >= 0 and self.columns[column] >= 0:
                    constants[int(self.rows[row] + self.columns[column])] = number
        return constants

    def has(self, block: MatrixBlock, shape: tuple[int, ...]) -> bool:
        """Returns True if the array holds any entry of a block of the matrix; `shape` is that of
        the block's node.
        """
        return bool(np.any(self._places(block.places(shape)) >= 0))

    def parts(self, block: MatrixBlock, value: Value) -> Iterator[tuple[Value, ArrayView]]:
        """Yields parts of the value of a block, each with the view of the array to store it in.

        Array indices within a part are affine in the indices of the part: one loop nest stores it.
        """
        yield from self._parts(self._places(block.places(value.shape)), value)

    def _parts(self, places: NDArray[np.int64], value: Value) -> Iterator[tuple[Value, ArrayView]]:
        """Yields parts of a value that has these array indices, one per loop nest."""
        is_here = places >= 0
        if not np.any(is_here):
            return
        # one loop nest if the array indices are an affine function of the indices of the value
        strides = _strides(places) if np.all(is_here) else None
        if strides is not None:
            begin = Index(int(places.flat[0]))
            yield value, ArrayView(Name(self.array), places.shape, strides, begin)
            return
        # otherwise splits the value in two and tries each half
        axis, cut = _cut(places)
        size = places.shape[axis]
        for start, stop in ((0, cut), (cut, size)):
            part = np.take(places, np.arange(start, stop), axis=axis)
            yield from self._parts(part, sliced(value, axis, start, stop))

    def _places(self, entries: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns the array index of each matrix entry, NOWHERE for entries that are not stored."""
        row, column = np.divmod(entries, self.matrix.shape[1])
        is_here = (self.rows[row] >= 0) & (self.columns[column] >= 0)
        if not self.takes_zeros:
            is_here &= np.array([self.matrix.known[i] is None for i in entries.flat]).reshape(
                entries.shape
            )
        return np.where(is_here, self.rows[row] + self.columns[column], NOWHERE)


def _strides(places: NDArray[np.int64]) -> tuple[int, ...] | None:
    """Returns the strides if array indices are an affine function of their axes, otherwise None."""
    # strides between the first element and its neighbours, which all other elements must confirm
    strides = tuple(
        int(np.take(places, 1, axis).flat[0] - places.flat[0]) if size > 1 else 0
        for axis, size in enumerate(places.shape)
    )
    grid: NDArray[np.int64] = np.array(places.flat[0])
    for size, stride in zip(places.shape, strides, strict=True):
        steps = np.array([stride * number for number in range(size)], np.int64)
        grid = np.add.outer(grid, steps)
    return strides if np.array_equal(grid, places) else None


def _cut(places: NDArray[np.int64]) -> tuple[int, int]:
    """Returns an axis and the index along it at which to split array indices that are not affine.

    That index is the first at which the stride or the presence of elements changes.
    """
    for axis, size in enumerate(places.shape):
        # the first axis along which the stride or the presence of elements changes
        if size < 2:
            continue
        lines = np.moveaxis(places, axis, 0).reshape(size, -1)
        is_here = lines >= 0
        steps = np.diff(lines, axis=0)
        is_regular = np.all((steps == steps[0]) & (is_here[1:] == is_here[:-1]), axis=1)
        if np.any(~np.all(is_here == is_here[0], axis=1)):
            is_regular = np.all(is_here[1:] == is_here[0], axis=1)
        elif np.all(is_regular):
            continue
        return axis, int(np.argmin(is_regular)) + 1
    # every axis alone is regular, only all together are not: any split makes progress
    return next((axis, 1) for axis, size in enumerate(places.shape) if size > 1)


@dataclass(frozen=True, slots=True)
class Place:
    """The location of a quantity: element (i, j, …) is array element first + Σ stride · index."""

    array: str
    first: int
    strides: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Series:
    """The layout of all time series of a condensed plan in one array `z`: those of states first,
    then those of controls.
    """

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
    """Computes the layout of the series of a problem; `form` is its window form, which tells how
    far each state and control is read back.
    """
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
