"""Strided views of memory, so that moving axes needs no copy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from backends.c_language.tree import Binary, Element, Expression, Name, Real, Truth, Unsigned


@dataclass(frozen=True, slots=True)
class Index:
    """An integer C expression: constant + Σ coefficient · variable. `terms` are (variable,
    coefficient); variables are loop counters and heads (write positions) of rings.
    """

    constant: int = 0
    terms: tuple[tuple[str, int], ...] = ()

    def plus(self, other: Index) -> Index:
        terms = dict(self.terms)
        for variable, coefficient in other.terms:
            terms[variable] = terms.get(variable, 0) + coefficient
        # drop terms with coefficient 0: an index without terms is constant
        kept = tuple((variable, c) for variable, c in terms.items() if c)
        return Index(self.constant + other.constant, kept)

    def times(self, factor: int) -> Index:
        # broadcast axes have stride 0: the counter must not appear
        if factor == 0:
            return Index()
        return Index(self.constant * factor, tuple((v, c * factor) for v, c in self.terms))

    def expression(self) -> Expression:
        result: Expression | None = None
        for variable, coefficient in self.terms:
            term: Expression = Name(variable)
            if coefficient != 1:
                term = Binary("*", term, Unsigned(coefficient))
            result = term if result is None else Binary("+", result, term)
        if result is None:
            return Unsigned(self.constant)
        return Binary("+", result, Unsigned(self.constant)) if self.constant else result


def variable(name: str) -> Index:
    return Index(0, ((name, 1),))


@dataclass(frozen=True, slots=True)
class ArrayView:
    """A value of this shape in C memory: the element with indices i has the position offset + Σ
    strides·i in the storage. The storage is the expression of an array, a scalar expression
    (`scalar`), or known values, of which an element with a constant index becomes a literal.
    """

    storage: Expression | tuple[float, ...]
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    offset: Index = Index()
    scalar: bool = False
    boolean: bool = False
    table: Callable[[], Expression] | None = None
    """Creates the array of known values, for a variable index."""

    @staticmethod
    def array(
        storage: Expression | tuple[float, ...],
        shape: tuple[int, ...],
        table: Callable[[], Expression] | None = None,
    ) -> ArrayView:
        """A view of all of `storage`, an array in C order of this shape. For known values, `table`
        declares an array when a loop reads them.
        """
        return ArrayView(storage, shape, c_strides(shape), table=table)

    @staticmethod
    def single(expression: Expression, boolean: bool = False) -> ArrayView:
        return ArrayView(expression, (), (), scalar=True, boolean=boolean)

    def of_kind(self, *, boolean: bool) -> ArrayView:
        return replace(self, boolean=boolean)

    def reshaped_single(self, shape: tuple[int, ...]) -> ArrayView:
        """A view of a scalar expression as a value of this shape, with equal elements."""
        assert self.scalar
        return self._bare(shape)

    def element(self, indices: Sequence[Index]) -> Expression:
        """The C expression of the element with these indices, one per axis."""
        if self.scalar:
            assert not isinstance(self.storage, tuple)
            return self.storage
        position = self.position(indices)
        if not isinstance(self.storage, tuple):
            return Element(self.storage, position.expression())
        # a literal; an array in flash is needed only for loops
        if not position.terms:
            number = self.storage[position.constant]
            return Truth(bool(number)) if self.boolean else Real(number)
        assert self.table is not None
        return Element(self.table(), position.expression())

    def position(self, indices: Sequence[Index]) -> Index:
        result = self.offset
        for index, stride in zip(indices, self.strides, strict=True):
            result = result.plus(index.times(stride))
        return result

    def repeated(self, shape: tuple[int, ...], kept: Sequence[int | None]) -> ArrayView:
        """A view of shape `shape` with axes in a new order: axis i is the old axis `kept[i]`, or
        for None the same elements are repeated along it.
        """
        # a stride of 0 repeats the same element
        strides = tuple(0 if axis is None else self.strides[axis] for axis in kept)
        if self.scalar:
            return self._bare(shape)
        return replace(self, shape=shape, strides=strides)

    def sliced(self, axis: int, start: int, stop: int) -> ArrayView:
        shape = (*self.shape[:axis], stop - start, *self.shape[axis + 1 :])
        if self.scalar:
            return self._bare(shape)
        return replace(
            self, shape=shape, offset=self.offset.plus(Index(start * self.strides[axis]))
        )

    def reshaped(self, shape: tuple[int, ...]) -> ArrayView | None:
        """A view of the same elements in C order with another shape; None if strides cannot express
        it, so that a copy is needed.
        """
        if self.scalar:
            return self._bare(shape)
        strides = _reshaped_strides(self.shape, self.strides, shape)
        return None if strides is None else replace(self, shape=shape, strides=strides)

    def _bare(self, shape: tuple[int, ...]) -> ArrayView:
        """A view of a scalar expression in a new shape; every element is the expression itself."""
        return replace(self, shape=shape, strides=(0,) * len(shape))


def c_strides(shape: tuple[int, ...]) -> tuple[int, ...]:
    strides: list[int] = []
    step = 1
    for size in reversed(shape):
        strides.append(step)
        step *= size
    return tuple(reversed(strides))


def _reshaped_strides(
    shape: tuple[int, ...], strides: tuple[int, ...], new: tuple[int, ...]
) -> tuple[int, ...] | None:
    """The strides of an array with these strides after a reshape from `shape` to `new`. None if
    axes would be joined that are not contiguous in memory.
    """
    # the stride of an axis with one element is never used
    old_axes = [(n, s) for n, s in zip(shape, strides, strict=True) if n != 1]
    new_sizes = [n for n in new if n != 1]
    found: list[int] = []
    i = j = 0
    while i < len(old_axes) and j < len(new_sizes):
        last_old, last_new = i, j
        old_size, new_size = old_axes[i][0], new_sizes[j]
        # the smallest groups of axes with the same number of elements
        while old_size != new_size:
            if old_size < new_size:
                last_old += 1
                old_size *= old_axes[last_old][0]
            else:
                last_new += 1
                new_size *= new_sizes[last_new]
        group = old_axes[i : last_old + 1]
        for (_, outer), (size, inner) in pairwise(group):
            # joined axes must be contiguous: outer stride = inner size · inner stride
            if outer != size * inner:
                return None
        step = group[-1][1]
        steps: list[int] = []
        for size in reversed(new_sizes[j : last_new + 1]):
            steps.append(step)
            step *= size
        found += reversed(steps)
        i, j = last_old + 1, last_new + 1
    remaining = iter(found)
    return tuple(0 if size == 1 else next(remaining) for size in new)
