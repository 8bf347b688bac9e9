"""Says where the entries of a matrix stand in an array of the solver, and writes them there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.c_language.places import ArrayView, Index
from backends.c_language.tree import Name
from backends.c_lowering.values import Value, sliced
from compiler.jacobian.matrices import Matrix, MatrixBlock

NOWHERE = -1


@dataclass(frozen=True, slots=True)
class PlacedMatrix:
    """A matrix, of which an array has the rows and columns that it wants."""

    array: str
    matrix: Matrix
    rows: NDArray[np.int64]
    """Where each row begins in the array; NOWHERE for one that the array lacks."""
    columns: NDArray[np.int64]
    """Where each column stands in a row; NOWHERE as above."""
    first: int
    """The part of the array that the rows fill: all that is not computed is written there."""
    last: int
    takes_zeros: bool = True
    """Whether entries that are always 0 are stored with the block that has them."""

    def known(self) -> dict[int, float]:
        """Numbers other than 0 that are always the same, by their places."""
        found: dict[int, float] = {}
        for entry, number in enumerate(self.matrix.known):
            if number:
                row, column = divmod(entry, self.matrix.shape[1])
                if self.rows[row] >= 0 and self.columns[column] >= 0:
                    found[int(self.rows[row] + self.columns[column])] = number
        return found

    def has(self, block: MatrixBlock, shape: tuple[int, ...]) -> bool:
        """Whether the array has any computed entry of a block."""
        return bool(np.any(self._places(block.places(shape)) >= 0))

    def parts(self, block: MatrixBlock, value: Value) -> Iterator[tuple[Value, ArrayView]]:
        """Parts of a block's value, each with the place that it is stored at."""
        yield from self._parts(self._places(block.places(value.shape)), value)

    def _parts(self, places: NDArray[np.int64], value: Value) -> Iterator[tuple[Value, ArrayView]]:
        is_here = places >= 0
        if not np.any(is_here):
            return
        # one loop where the places are an affine function of the indices
        strides = _strides(places) if np.all(is_here) else None
        if strides is not None:
            begin = Index(int(places.flat[0]))
            yield value, ArrayView(Name(self.array), places.shape, strides, begin)
            return
        # otherwise in two parts, each of which may be one
        axis, cut = _cut(places)
        size = places.shape[axis]
        for start, stop in ((0, cut), (cut, size)):
            part = np.take(places, np.arange(start, stop), axis=axis)
            yield from self._parts(part, sliced(value, axis, start, stop))

    def _places(self, entries: NDArray[np.int64]) -> NDArray[np.int64]:
        row, column = np.divmod(entries, self.matrix.shape[1])
        is_here = (self.rows[row] >= 0) & (self.columns[column] >= 0)
        if not self.takes_zeros:
            is_here &= np.array([self.matrix.known[i] is None for i in entries.flat]).reshape(
                entries.shape
            )
        return np.where(is_here, self.rows[row] + self.columns[column], NOWHERE)


def _strides(places: NDArray[np.int64]) -> tuple[int, ...] | None:
    """The strides of places that are an affine function of their indices."""
    # a guess from the neighbours of the first place, which all others then have to bear out
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
    """The axis, and the place on it, at which places stop going on as they began."""
    for axis, size in enumerate(places.shape):
        # the first axis along which places change their step, or end
        if size < 2:
            continue
        lines = np.moveaxis(places, axis, 0).reshape(size, -1)
        is_here = lines >= 0
        steps = np.diff(lines, axis=0)
        goes_on = np.all((steps == steps[0]) & (is_here[1:] == is_here[:-1]), axis=1)
        if np.any(~np.all(is_here == is_here[0], axis=1)):
            goes_on = np.all(is_here[1:] == is_here[0], axis=1)
        elif np.all(goes_on):
            continue
        return axis, int(np.argmin(goes_on)) + 1
    # each axis goes on as it began, all together do not: any cut leads on
    return next((axis, 1) for axis, size in enumerate(places.shape) if size > 1)
