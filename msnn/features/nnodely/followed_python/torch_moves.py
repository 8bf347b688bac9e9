"""Translates torch functions that create tensors or rearrange their elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from msnn.features.nnodely import arrays
from msnn.features.nnodely.arrays import Elements, NotTranslatedError
from msnn.features.nnodely.followed_python.torch_names import SAME
from msnn.features.nnodely.terms import times


def _shape(sizes: Sequence[Any]) -> list[int]:
    flat = list(sizes)
    if len(flat) == 1 and isinstance(flat[0], list):
        flat = cast("list[Any]", flat[0])
    if not all(isinstance(one, int) for one in flat):
        raise NotTranslatedError("a shape that is not made of whole numbers")
    # judged in floats before anything is made: the product of whole numbers may overflow numpy's
    arrays.refuse_large(float(np.prod([abs(float(one)) for one in flat] or [1.0])))
    return flat


def _index(array: Elements, index: Any) -> Elements:
    return arrays.tensor(cast("Any", array[index]))


def _full(sizes: Any, fill_value: float) -> Elements:
    return arrays.tensor(np.full(_shape(sizes), float(fill_value)))


def _zeros(*sizes: Any) -> Elements:
    return _full(sizes, 0.0)


def _ones(*sizes: Any) -> Elements:
    return _full(sizes, 1.0)


def _full_like(like: Any, fill_value: float) -> Elements:
    return _full(like.shape, fill_value)


def _zeros_like(like: Any) -> Elements:
    return _full(like.shape, 0.0)


def _ones_like(like: Any) -> Elements:
    return _full(like.shape, 1.0)


def _range(start: float, end: float | None = None, step: float = 1.0) -> Elements:
    first, last = (0.0, start) if end is None else (start, end)
    arrays.refuse_large(abs((last - first) / step))
    return arrays.tensor(np.arange(first, last, step, dtype=np.float64))


def _linspace(start: float, end: float, steps: int) -> Elements:
    [count] = _shape([steps])
    return arrays.tensor(np.linspace(start, end, count))


def _eye(n: int) -> Elements:
    [count] = _shape([n])
    # its size is judged before it is made
    _shape([count, count])
    return arrays.tensor(np.eye(count))


def _mean(array: Elements, dim: Any = None, keepdim: bool = False) -> Elements:
    return arrays.averaged(array, dim, keepdim)


def _sum(array: Elements, dim: Any = None, keepdim: bool = False) -> Elements:
    return arrays.summed(array, dim, keepdim)


def _norm(array: Elements, p: Any = None, dim: Any = None, keepdim: bool = False) -> Elements:
    # the second argument is the power; 2 over all axes is another norm in torch.linalg
    if p not in (None, "fro") and not (p == 2 and isinstance(dim, int)):
        raise NotTranslatedError("a `norm` that is not the root of the sum of squares")
    squares = arrays.elementwise(times, array, array)
    return arrays.elementwise(SAME["sqrt"], arrays.summed(squares, dim, keepdim))


def _product(array: Elements, dim: int, keepdim: bool = False) -> Elements:
    moved = np.moveaxis(array, dim, 0)
    out = moved[0]
    for one in moved[1:]:
        # in order, as torch multiplies along an axis
        out = arrays.elementwise(arrays.product, out, one)
    return np.expand_dims(out, dim) if keepdim else out


def _largest(array: Elements, dim: int, keepdim: bool = False) -> Elements:
    return arrays.extreme("max", array, dim, keepdim)


def _smallest(array: Elements, dim: int, keepdim: bool = False) -> Elements:
    return arrays.extreme("min", array, dim, keepdim)


def _softmax(array: Elements, dim: int = -1) -> Elements:
    return arrays.softmax(array, dim)


def _cat(tensors: Sequence[Elements], dim: int = 0) -> Elements:
    arrays.refuse_large(sum(one.size for one in tensors))
    return np.concatenate(tensors, axis=dim)


def _stack(tensors: Sequence[Elements], dim: int = 0) -> Elements:
    arrays.refuse_large(sum(one.size for one in tensors))
    return np.stack(tensors, axis=dim)


def _transpose(array: Elements, dim0: int, dim1: int) -> Elements:
    return np.swapaxes(array, dim0, dim1)


def _turned(array: Elements) -> Elements:
    return array.T


def _permute(array: Elements, *dims: Any) -> Elements:
    return array.transpose(_shape(dims))


def _reshape(array: Elements, *shape: Any) -> Elements:
    return arrays.shaped(array, _shape(shape))


def _flatten(array: Elements, start_dim: int = 0) -> Elements:
    return arrays.shaped(array, [*array.shape[:start_dim], -1])


def _squeeze(array: Elements, dim: int | None = None) -> Elements:
    return arrays.squeezed(array, dim)


def _unsqueeze(array: Elements, dim: int) -> Elements:
    return np.expand_dims(array, dim)


def _expand(array: Elements, *sizes: Any) -> Elements:
    return arrays.expanded(array, _shape(sizes))


def _repeat(array: Elements, *counts: Any) -> Elements:
    return arrays.repeated(array, _shape(counts))


def _flip(array: Elements, *dims: Any) -> Elements:
    return np.flip(array, tuple(_shape(dims)))


def _roll(array: Elements, shifts: int, dims: int) -> Elements:
    return np.roll(array, shifts, axis=dims)


def _chunk(array: Elements, chunks: int, dim: int = 0) -> list[Elements]:
    # chunks of torch are as large as they have to be, the last one smaller
    return arrays.parts(array, -(-array.shape[dim] // chunks), dim)


def _split(array: Elements, sizes: Any, dim: int = 0) -> list[Elements]:
    return arrays.parts(array, sizes, dim)


def _einsum(equation: str, *operands: Elements) -> Elements:
    """An einsum such as `bij,bj->bi`: products of elements, summed over the letters that are
    missing in the result. Raises NotTranslatedError without `->`, and for repeated letters in one
    operand.
    """
    given, arrow, result = equation.replace(" ", "").partition("->")
    # implicit results, repeated letters and `...` are forms of their own, refused
    letters = given.split(",")
    fits = all(len(one) == array.ndim for one, array in zip(letters, operands, strict=True))
    if not (arrow and fits and all(len(set(one)) == len(one) for one in [*letters, result])):
        raise NotTranslatedError("an `einsum` of this form")
    # axes of the result first, behind them those that are summed
    order = [*result, *sorted(set("".join(letters)) - set(result))]
    spread: list[Elements] = []
    for one, array in zip(letters, operands, strict=True):
        turned = array.transpose(sorted(range(len(one)), key=lambda k, of=one: order.index(of[k])))
        # axes that an operand lacks become axes of 1, which broadcast
        spread.append(turned[tuple(slice(None) if axis in one else None for axis in order)])
    products = spread[0]
    for other in spread[1:]:
        products = arrays.elementwise(arrays.product, products, other)
    return arrays.summed(products, range(len(result), len(order)), keepdim=False)


MAKERS: Mapping[str, Callable[..., Any]] = {
    "tensor": arrays.tensor,
    "as_tensor": arrays.tensor,
    "zeros": _zeros,
    "ones": _ones,
    "full": _full,
    "zeros_like": _zeros_like,
    "ones_like": _ones_like,
    "full_like": _full_like,
    "arange": _range,
    "linspace": _linspace,
    "eye": _eye,
}
"""Functions that create a tensor; they use only the shape of another one."""

MOVES: Mapping[str, Callable[..., Any]] = {
    "__getitem__": _index,
    "sum": _sum,
    "mean": _mean,
    "matmul": arrays.matmul,
    "mm": arrays.matmul,
    "bmm": arrays.matmul,
    "mv": arrays.matmul,
    "dot": arrays.matmul,
    "softmax": _softmax,
    "amax": _largest,
    "amin": _smallest,
    "cat": _cat,
    "concat": _cat,
    "concatenate": _cat,
    "stack": _stack,
    "transpose": _transpose,
    "swapaxes": _transpose,
    "t": _turned,
    "permute": _permute,
    "reshape": _reshape,
    "view": _reshape,
    "flatten": _flatten,
    "squeeze": _squeeze,
    "unsqueeze": _unsqueeze,
    "expand": _expand,
    "repeat": _repeat,
    "flip": _flip,
    "roll": _roll,
    "chunk": _chunk,
    "split": _split,
    "norm": _norm,
    "einsum": _einsum,
    "prod": _product,
}
"""Functions and methods that rearrange, sum or compare elements of tensors."""
