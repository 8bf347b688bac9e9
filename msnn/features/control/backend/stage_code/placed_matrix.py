"""Maps the entries of a Jacobian or Hessian to elements of an array of the generated solver."""

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
        """Returns True if the array holds any entry of a block whose node has this shape."""
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
