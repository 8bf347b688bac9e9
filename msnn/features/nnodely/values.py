"""Represents a value of nnodely, samples by elements, as terms along time."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from msnn.features.nnodely.names import Dims
from msnn.features.nnodely.terms import Call, Cutter, Named, Term, call, infix, joined, number

_MOST = 10_000
"""Maximum number of values joined along time or elements."""


class ShapeError(Exception):
    """Values have incompatible windows or sizes; the text names them."""


@dataclass(frozen=True, slots=True)
class Value:
    """A value of nnodely: `window` samples with `dim` elements each. `pieces` are terms of one or
    more samples that follow each other in time.
    """

    window: int
    dim: int
    pieces: tuple[Term, ...]


def refuse_many(count: int) -> None:
    """Raises ShapeError if more than `_MOST` values are to be joined; `count` is their number."""
    if count > _MOST:
        raise ShapeError(f"more than {_MOST:,} values are joined")


def one_piece(term: Term) -> Value:
    """A value written as one term."""
    return Value(term.window or 1, term.dim, (term,))


@dataclass(frozen=True, slots=True)
class ValueOperations:
    """Operations on values: slices in time, single elements, and concatenation."""

    dims: Dims
    cutter: Cutter

    def elementwise(self, make: Callable[..., Term], *values: Value) -> Value:
        """Applies `make` to terms of the values; a single sample or element applies to all samples
        or elements. Raises ShapeError if windows or sizes differ otherwise.
        """
        sizes = {value.dim for value in values} - {1}
        windows = {value.window for value in values} - {1}
        if len(sizes) > 1 or len(windows) > 1:
            listed = " and ".join(f"{value.window} × {value.dim}" for value in values)
            raise ShapeError(f"samples × elements of {listed} do not go together")
        window = max(value.window for value in values)
        # pieces of the values begin at other samples: cut wherever one of them begins, so that each
        # piece of the result has one term of each
        marks = sorted({mark for value in values for mark in _marks(value)} | {0, window})
        pieces = [
            make(*(self._stretch(value, first, end) for value in values))
            for first, end in itertools.pairwise(marks)
        ]
        return Value(window, max(sizes, default=1), tuple(pieces))

    def along(self, make: Callable[[Term], Term], value: Value, dim: int) -> Value:
        """Applies `make` to each piece of a value, where it changes the elements of each sample;
        the result has `dim` elements.
        """
        return Value(value.window, dim, tuple(make(piece) for piece in value.pieces))

    def samples(self, value: Value, first: int, end: int) -> Value:
        """The samples from `first` to `end` − 1 of a value, counted from the oldest. Raises
        ShapeError if they do not exist, CutError if they are not available separately.
        """
        if not 0 <= first < end <= value.window:
            raise ShapeError(f"samples {first} … {end - 1} of {value.window} do not exist")
        pieces: list[Term] = []
        for start, piece in _placed(value):
            low, high = max(first, start), min(end, start + (piece.window or 1))
            if low < high:
                pieces.append(self.cutter.cut(piece, low - start, high - start))
        return Value(end - first, value.dim, tuple(pieces))

    def after(self, *values: Value) -> Value:
        """Concatenates values along time, oldest first. Raises ShapeError for different numbers of
        elements.
        """
        sizes = {value.dim for value in values}
        if len(sizes) > 1:
            raise ShapeError("values of different sizes do not follow each other in time")
        refuse_many(sum(len(value.pieces) for value in values))
        pieces = tuple(piece for value in values for piece in value.pieces)
        return Value(sum(value.window for value in values), sizes.pop(), pieces)

    def beside(self, *values: Value) -> Value:
        """Concatenates the elements of values, sample by sample. Raises ShapeError for different
        windows.
        """
        refuse_many(sum(value.dim for value in values))
        elements = [self.element(value, i) for value in values for i in range(value.dim)]
        return self.stacked(elements)

    def stacked(self, elements: Sequence[Value]) -> Value:
        """Combines scalar values to one value, of which they are the elements. Raises ShapeError
        for different windows.
        """
        if len(elements) == 1:
            return elements[0]
        refuse_many(len(elements))
        rest = f", dim={self.dims.of(len(elements))}"

        def stack(*terms: Term) -> Term:
            return call("stack", *terms, rest=rest, dim=len(elements))

        value = self.elementwise(stack, *elements)
        return Value(value.window, len(elements), value.pieces)

    def element(self, value: Value, index: int) -> Value:
        """The element `index` of every sample of a value, as a value. Raises ShapeError if it does
        not exist.
        """
        if not 0 <= index < value.dim:
            raise ShapeError(f"element {index} of {value.dim} does not exist")
        if value.dim == 1:
            return value
        return self.along(lambda term: element_of(term, index, self.dims), value, 1)

    def whole(self, value: Value) -> Term:
        """All samples of a value as one term: a window if the value is one piece, else its pieces
        joined along an unnamed axis.
        """
        if len(value.pieces) == 1:
            return value.pieces[0]
        refuse_many(value.window)
        if value.dim == 1:
            # windows are flattened into one unnamed axis (R3)
            return Term(Call("concat", steady=False), value.pieces)
        single = [self.samples(value, k, k + 1).pieces[0] for k in range(value.window)]
        return Term(Call("stack", steady=False), tuple(single), None, value.dim)

    def _stretch(self, value: Value, first: int, end: int) -> Term:
        if value.window == 1:
            return value.pieces[0]
        return self.whole(self.samples(value, first, end))


def element_of(term: Term, index: int, dims: Dims) -> Term:
    """Element `index` of a term with a dimension, as a term; of a `stack` the operand itself."""
    match term.head:
        # no `part` of a `stack`: the element itself is shorter and shared
        case Call("stack") if len(term.args) == term.dim:
            return term.args[index]
        case Named(axes=axes) if len(axes) > 1:
            return joined(Call("part", f", {dims.label(axes[0], index)}"), term, dim=1)
        case _:
            return joined(Call("part", f", {index}"), term, dim=1)


def filled(value: float, like: Value) -> Value:
    """A scalar value that is the constant `value` at each sample, with the window of `like`."""
    if like.window == 1:
        return one_piece(number(value))
    # a number has no window; 0 times the value lends it one
    pieces = [infix("+", number(value), infix("*", number(0), term)) for term in like.pieces]
    scalar = [Term(t.head, t.args, t.window) for t in pieces]
    return Value(like.window, 1, tuple(scalar))


def _marks(value: Value) -> Iterator[int]:
    return (start for start, _ in _placed(value)) if value.window > 1 else iter(())


def _placed(value: Value) -> Iterator[tuple[int, Term]]:
    start = 0
    for piece in value.pieces:
        yield start, piece
        start += piece.window or 1
