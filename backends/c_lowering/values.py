"""Represents a value on its way into C: a place, or a recipe that is written where it is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Expression
from compiler.ir.types import Type

Indices = Sequence[Index]
Finish = Callable[[Expression, BlockScope], Expression]


@dataclass(frozen=True, slots=True)
class Computed:
    """A value whose elements are made, once each, by writing statements into a block."""

    shape: tuple[int, ...]
    make: Callable[[Indices, BlockScope], Expression]
    """The element's expression; what it needs has been written into the block."""
    depth: int
    """Recipes inside one another, this one included."""
    finish: Finish | None = None
    """Gives the expression a name where it is to be a part of another one."""

    def element(self, indices: Indices, scope: BlockScope) -> Expression:
        made = self.make(indices, scope)
        return made if self.finish is None else self.finish(made, scope)


Value = ArrayView | Computed


def element_of(value: Value, indices: Indices, scope: BlockScope) -> Expression:
    """One element as a part of another expression."""
    if isinstance(value, ArrayView):
        return value.element(indices)
    return value.element(indices, scope)


def copy_value(value: Value, target: ArrayView, scope: BlockScope, unroll: int) -> None:
    """Writes every element of a value to the same element of a place."""

    def one(indices: tuple[Index, ...], inner: BlockScope) -> None:
        if isinstance(value, ArrayView):
            made = value.element(indices)
        else:
            # not `element`, whose finish would name what gets its name from the target
            made = value.make(indices, inner)
        inner.assign(target.element(indices), made)

    scope.each(target.shape, unroll, one)


def depth_of(value: Value) -> int:
    return value.depth if isinstance(value, Computed) else 0


def repeated(value: Value, old: Type, new: Type) -> Value:
    """The value along the axes of a broadcast."""
    kept = [old.axis_names.index(n) if n in old.axis_names else None for n in new.axis_names]
    if isinstance(value, ArrayView):
        return value.repeated(new.shape, kept)

    # the indices of the old axes among those of the new; a repeated axis has none
    def moved(indices: Indices) -> Indices:
        # index 0 stays for axes of size 1 that the new shape lacks
        result = [Index()] * len(old.shape)
        for index, axis in zip(indices, kept, strict=True):
            if axis is not None:
                result[axis] = index
        return result

    return _seen_through(value, new.shape, moved)


def sliced(value: Value, axis: int, start: int, stop: int) -> Value:
    """Elements start … stop−1 along an axis."""
    if isinstance(value, ArrayView):
        return value.sliced(axis, start, stop)

    def moved(indices: Indices) -> Indices:
        return [*indices[:axis], indices[axis].plus(Index(start)), *indices[axis + 1 :]]

    return _seen_through(
        value, (*value.shape[:axis], stop - start, *value.shape[axis + 1 :]), moved
    )


def with_units_moved(value: Computed, old: tuple[int, ...], new: tuple[int, ...]) -> Computed:
    """The value under a shape that differs in axes of length 1 only."""

    def moved(indices: Indices) -> Indices:
        longer = iter([i for i, size in zip(indices, new, strict=True) if size != 1])
        return [Index() if size == 1 else next(longer) for size in old]

    return _seen_through(value, new, moved)


def _seen_through(
    value: Computed, shape: tuple[int, ...], moved: Callable[[Indices], Indices]
) -> Computed:
    def make(indices: Indices, scope: BlockScope) -> Expression:
        return value.element(moved(indices), scope)

    return Computed(shape, make, value.depth + 1)
