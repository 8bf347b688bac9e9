"""Implements torch functions that rearrange or sum elements, on arrays of terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from msnn.features.nnodely.terms import (
    Number,
    Term,
    call,
    infix,
    minus,
    number,
    plus,
    quotient,
    same,
)

Elements: TypeAlias = NDArray[np.object_]
"""A tensor with a term per element."""

MOST = 10_000
"""Maximum elements of a tensor, per row."""
ROWS = 3
"""Rows evaluated together, to detect dependencies between them."""


class NotTranslatedError(Exception):
    """A part of a Python function is not supported; the text gives the reason."""


def tensor(value: Any) -> Elements:
    """An array of terms from an array, a term, a number or nested lists of numbers. Raises
    NotTranslatedError for anything else.
    """
    if isinstance(value, np.ndarray):
        return cast("Elements", value)
    if isinstance(value, Term):
        return _filled(value)
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise NotTranslatedError("a tensor is made of what are no numbers") from None
    return elementwise(same, numbers)


def refuse_large(size: float) -> None:
    """Raises NotTranslatedError if a tensor would have more than ROWS · MOST elements; `size` is
    their number.
    """
    if size > ROWS * MOST:
        raise NotTranslatedError(f"a tensor has more than {MOST:,} elements")


def _filled(value: Term) -> Elements:
    single = np.empty((), dtype=object)
    # numpy would take a Term for a sequence where it could
    single[()] = value
    return single


def elementwise(make: Callable[..., Term], *operands: Any) -> Elements:
    """Applies `make` to the elements of operands, with broadcasting as in torch and numpy. Operands
    are arrays, terms or numbers.

    Raises NotTranslatedError for other operands, shapes that do not broadcast, and large results.
    """
    arrays = [_operand(operand) for operand in operands]
    try:
        together = np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        raise NotTranslatedError("tensors whose shapes do not go together") from None
    # before it is made; in floats, as whole numbers may overflow
    refuse_large(float(np.prod([float(n) for n in together])))
    out = np.empty(together, dtype=object)
    spread = [np.broadcast_to(array, together) for array in arrays]
    for index in np.ndindex(*together):
        out[index] = make(*(_term(array[index]) for array in spread))
    return out


def _operand(value: Any) -> NDArray[Any]:
    if isinstance(value, np.ndarray):
        return cast("NDArray[Any]", value)
    if isinstance(value, Term):
        return _filled(value)
    if isinstance(value, bool | int | float):
        return _filled(number(float(value)))
    raise NotTranslatedError(f"arithmetic with a {type(value).__name__}")


def _term(value: Any) -> Term:
    return value if isinstance(value, Term) else number(float(value))


def total(terms: Sequence[Term]) -> Term:
    """A term for the sum of terms; zeros are omitted."""
    kept = [t for t in terms if not (isinstance(t.head, Number) and t.head.value == 0)]
    return reduce(plus, kept) if kept else number(0)


def product(left: Term, right: Term) -> Term:
    """The product of two terms; with a factor 0 or 1 it is 0 or the other term."""
    for one, other in ((left, right), (right, left)):
        if isinstance(one.head, Number):
            if one.head.value == 0:
                return number(0)
            if one.head.value == 1:
                return other
    return infix("*", left, right)


def summed(array: Elements, dim: int | Sequence[int] | None, keepdim: bool) -> Elements:
    """Sums an array over the axes `dim`, or over all axes for None; `keepdim` keeps them with
    length 1.
    """
    axes = range(array.ndim) if dim is None else (dim,) if isinstance(dim, int) else tuple(dim)
    axes = {axis % max(array.ndim, 1) for axis in axes}
    # what is summed moves behind, in its order: terms are added as torch's memory has them
    order = [a for a in range(array.ndim) if a not in axes] + sorted(axes)
    kept = [array.shape[a] for a in range(array.ndim) if a not in axes]
    flat = array.transpose(order).reshape(*kept, -1)
    out = np.empty(tuple(kept), dtype=object)
    for index in np.ndindex(*kept):
        out[index] = total(list(flat[index]))
    if keepdim:
        return out.reshape([1 if a in axes else n for a, n in enumerate(array.shape)])
    return out


def averaged(array: Elements, dim: int | Sequence[int] | None, keepdim: bool) -> Elements:
    """The mean over the axes `dim`, or over all axes for None; `keepdim` keeps them with
    length 1.
    """
    sums = summed(array, dim, keepdim)
    count = array.size // max(sums.size, 1)
    # Σ / n, as torch divides
    return elementwise(quotient, sums, count)


def matmul(left: Elements, right: Elements) -> Elements:
    """The matrix product as in torch, with batches: (…, n, k) · (…, k, m) to (…, n, m); vectors are
    rows on the left and columns on the right.

    Raises NotTranslatedError for scalars and sizes that do not fit.
    """
    if left.ndim == 0 or right.ndim == 0:
        raise NotTranslatedError("a matrix product of a scalar")
    # a vector is a row on the left and a column on the right; its axis is dropped at the end
    a = left[None, :] if left.ndim == 1 else left
    b = right[:, None] if right.ndim == 1 else right
    if a.shape[-1] != b.shape[-2]:
        raise NotTranslatedError("a matrix product of sizes that do not fit")
    # (…, rows, 1, inner) · (…, 1, columns, inner)
    products = elementwise(product, a[..., :, None, :], np.swapaxes(b, -1, -2)[..., None, :, :])
    out = summed(products, -1, keepdim=False)
    out = out[..., 0] if right.ndim == 1 else out
    return (
        out[..., 0, :]
        if left.ndim == 1 and right.ndim > 1
        else (out[..., 0] if left.ndim == 1 else out)
    )


def softmax(array: Elements, dim: int) -> Elements:
    """Softmax along the axis `dim`, element i as 1 / Σⱼ exp(xⱼ − xᵢ), because exp(xᵢ) / Σⱼ exp(xⱼ)
    overflows.
    """
    moved = np.moveaxis(array, dim, -1)
    above = elementwise(minus, moved[..., None, :], moved[..., :, None])
    sums = summed(elementwise(partial(call, "exp"), above), -1, keepdim=False)
    return np.moveaxis(elementwise(quotient, number(1.0), sums), -1, dim)


def extreme(name: str, array: Elements, dim: int, keepdim: bool) -> Elements:
    """The maximum or minimum (`name` is `max` or `min`) along the axis `dim`, as terms that call
    the function of the spec. `keepdim` keeps the axis with length 1.
    """
    moved = np.moveaxis(array, dim, -1)
    out = np.empty(moved.shape[:-1], dtype=object)
    for index in np.ndindex(*out.shape):
        row = cast("list[Term]", list(moved[index]))
        out[index] = call(name, *row) if len(row) > 1 else row[0]
    return np.expand_dims(out, dim) if keepdim else out


def shaped(array: Elements, shape: Sequence[int]) -> Elements:
    """Reshapes an array; one length of `shape` may be −1 and is inferred. Raises NotTranslatedError
    if the elements do not fit.
    """
    try:
        return array.reshape(tuple(shape))
    except (ValueError, TypeError):
        raise NotTranslatedError("a shape that does not hold the elements") from None


def squeezed(array: Elements, dim: int | None) -> Elements:
    """Removes the axis `dim` if its length is 1, or all such axes for None, as in torch."""
    if dim is None:
        return array.reshape([n for n in array.shape if n != 1])
    return np.squeeze(array, axis=dim) if array.shape[dim] == 1 else array


def repeated(array: Elements, counts: Sequence[int]) -> Elements:
    """Repeats an array `counts` times along each axis, as numpy's `tile`. Raises NotTranslatedError
    if the result is too large.
    """
    refuse_large(float(np.prod([float(n) for n in counts])) * array.size)
    return np.tile(array, tuple(counts))


def expanded(array: Elements, shape: Sequence[int]) -> Elements:
    """Repeats axes of length 1 to the lengths in `shape`, as torch's `expand`; −1 keeps an axis.
    Raises ValueError for shapes that do not fit.
    """
    old = (1,) * (len(shape) - array.ndim) + array.shape
    wanted = [n if m == -1 else m for m, n in zip(shape, old, strict=True)]
    return np.broadcast_to(array.reshape(old), wanted)


def parts(array: Elements, size: int | Sequence[int], dim: int) -> list[Elements]:
    """Splits an array along the axis `dim`: into parts of length `size`, the last one shorter, or
    into parts whose lengths are listed.
    """
    length = array.shape[dim]
    sizes = [size] * -(-length // size) if isinstance(size, int) else list(size)
    return list(np.split(array, np.cumsum(sizes)[:-1], axis=dim))


KEYWORDS: Mapping[str, str] = {"axis": "dim", "keepdims": "keepdim", "input": "self", "out": "?"}
"""Alternative names of keywords in torch."""
