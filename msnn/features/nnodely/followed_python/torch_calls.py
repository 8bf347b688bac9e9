"""Translates torch calls in an interpreted function, on complete values or on elements."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, cast

import numpy as np

from msnn.features.nnodely import arrays
from msnn.features.nnodely.arrays import Elements, NotTranslatedError
from msnn.features.nnodely.followed_python.torch_moves import MAKERS, MOVES
from msnn.features.nnodely.followed_python.torch_names import ARGUMENTS, SCALAR
from msnn.features.nnodely.terms import (
    Call,
    Infix,
    Number,
    Term,
    call,
    infix,
    larger,
    number,
    plus,
    same,
    smaller,
)


class NeedsElementsError(Exception):
    """An operation on a `Whole` that is only supported on separate elements; the caller tries again
    with these.
    """


@dataclass(frozen=True, slots=True)
class Whole:
    """A tensor that is one term of the spec, with the shape that it has in torch."""

    term: Term
    shape: tuple[int, ...]


Tensor: TypeAlias = "Whole | Elements"
_SAME = {
    "detach",
    "contiguous",
    "float",
    "double",
    "to",
    "type",
    "requires_grad_",
    "type_as",
}
_FLOATS = frozenset({"torch.float", "torch.float32", "torch.float64", "torch.double"})
_DEEPEST_TRUTH = 8
_MATH = {
    "sqrt",
    "exp",
    "log",
    "sin",
    "cos",
    "tan",
    "atan",
    "tanh",
    "pow",
    "atan2",
    "fabs",
    "radians",
}


def elementwise(make: Callable[..., Term], *operands: Any) -> Tensor:
    """Applies `make` to the elements of the operands. If one is a `Whole`, applies it to complete
    terms instead; other operands are then single numbers.

    Raises NeedsElementsError if another operand has several elements, and NotTranslatedError for
    shapes that do not broadcast.
    """
    # an array of terms, as the elements of a stream or numbers
    if not any(isinstance(operand, Whole) for operand in operands):
        return arrays.elementwise(make, *operands)
    terms: list[Term] = []
    shapes: list[tuple[int, ...]] = []
    for operand in operands:
        match operand:
            case Whole(term, shape):
                terms.append(term)
                shapes.append(shape)
            case bool() | int() | float():
                terms.append(number(float(operand)))
            # one number goes with a whole value; an array would have another value for each element
            case np.ndarray() if cast("Elements", operand).size == 1:
                array = cast("Elements", operand)
                terms.append(array.reshape(-1)[0])
                shapes.append(array.shape)
            case _:
                raise NeedsElementsError
    try:
        # the shape of torch is kept beside the term: the language knows samples and dims, no batch
        return Whole(make(*terms), np.broadcast_shapes(*shapes))
    except ValueError:
        raise NotTranslatedError("tensors whose shapes do not go together") from None


def condition(value: Term) -> Term:
    """A term as the condition of `where`: the comparison from which it was made, else term > 0.5,
    because true is 1 and false 0 in terms.
    """
    match value.head:
        case Call("where") if len(value.args) == 3 and _is_flag(value):
            return value.args[0]
        case _:
            # truths computed by sums and products are 1 or 0; a half lies between, whatever
            # rounding did
            return infix(">", value, number(0.5))


def _is_flag(value: Term) -> bool:
    return [getattr(arg.head, "value", None) for arg in value.args[1:]] == [1.0, 0.0]


def _is_truth(value: Term, depth: int = _DEEPEST_TRUTH) -> bool:
    """True if the term is surely a boolean in torch: a comparison, or a combination of them.

    The search ends after `depth` levels of combinations, and then returns False.
    """
    match value.head:
        # a chain of `&` is judged so far down alone: terms share parts, and a tree of them is
        # exponential
        case _ if depth == 0:
            return False
        case Call("where") if len(value.args) == 3:
            return all(isinstance(getattr(arg.head, "value", None), bool) for arg in value.args[1:])
        # `&`, `|` and `~` as they are written: products, largest, and 1 − a
        case Infix("*") | Call("max" | "min"):
            return all(_is_truth(arg, depth - 1) for arg in value.args)
        case Infix("-"):
            return isinstance(value.args[0].head, Number) and _is_truth(value.args[1], depth - 1)
        case _:
            return False


def _flag(name: str, left: Term, right: Term) -> Term:
    return call("where", SCALAR[name](left, right), number(True), number(False))


def added(left: Term, right: Term) -> Term:
    """A sum of two terms; for two booleans, true if any is true, as in torch."""
    return larger(left, right) if _is_truth(left) and _is_truth(right) else plus(left, right)


def _as_number(value: Term) -> Term:
    return call("where", condition(value), number(1), number(0)) if _is_truth(value) else value


def _is_whole(value: Any) -> bool:
    known = (
        value.head.value if isinstance(value, Term) and isinstance(value.head, Number) else value
    )
    return isinstance(known, int | float) and float(known).is_integer()


def _refuse_other_types(name: str, kinds: Sequence[Any]) -> None:
    for kind in kinds:
        path = getattr(kind, "path", None)
        if path is not None and path not in _FLOATS:
            raise NotTranslatedError(f"`{name}` to `{path}`")


def _converted(name: str, value: Any, kinds: Sequence[Any]) -> Any:
    """The tensor as floating-point numbers; booleans become 1 and 0. `name` is the method, `kinds`
    are its arguments. Raises NotTranslatedError for other types, as integers would lose the
    fractional part.
    """
    _refuse_other_types(name, kinds)
    # `.to("cpu")` changes nothing, `.to(torch.float32)` makes truths numbers
    if name in {"float", "double"} or any(hasattr(kind, "path") for kind in kinds):
        terms = [value.term] if isinstance(value, Whole) else value.ravel()
        return elementwise(_as_number, value) if any(map(_is_truth, terms)) else value
    return value


def _where(chosen: Term, then: Term, otherwise: Term) -> Term:
    return call("where", condition(chosen), then, otherwise)


def torch_function(
    owner: str, name: str, arguments: Sequence[Any], keywords: Mapping[str, Any]
) -> Any:
    """The result of a call of the function `name` of the module `owner`, torch or math. Raises
    NotTranslatedError if it is not supported, NeedsElementsError if it needs the elements of a
    `Whole`.
    """
    if owner == "math":
        numbers = [a for a in arguments if isinstance(a, bool | int | float)]
        if name not in _MATH or len(numbers) != len(arguments) or keywords:
            raise NotTranslatedError(f"the call of `math.{name}`")
        return float(getattr(np, name)(*(float(a) for a in numbers)))
    if owner not in {"torch", "torch.nn.functional", "torch.special", "torch.linalg"}:
        raise NotTranslatedError(f"the call of `{owner}.{name}`")
    made = MAKERS.get(name)
    if made is not None:
        if name in {"tensor", "as_tensor"} and _has_whole(list(arguments)):
            raise NeedsElementsError
        out = made(*arguments, **_plain(keywords))
        # `torch.tensor([1, 2], dtype=torch.long)` loses nothing; 0.5 would
        if not all(_is_whole(one) for one in out.ravel()):
            _refuse_other_types(name, [keywords[key] for key in keywords if key == "dtype"])
        return out
    if not arguments:
        raise NotTranslatedError(f"the call of `{owner}.{name}`")
    return method(name, list(arguments), keywords)


def method(name: str, arguments: list[Any], keywords: Mapping[str, Any]) -> Any:
    """The result of a method of a tensor, `arguments[0]`, or of the equivalent `torch.name(x)`.
    Raises NotTranslatedError if it is not supported, NeedsElementsError if it needs the elements of
    a `Whole`.
    """
    # a new value: what is changed in place is then nobody else's
    if name == "clone":
        return elementwise(same, arguments[0])
    if name in _SAME:
        return _converted(name, arguments[0], [*arguments[1:], *keywords.values()])
    _refuse_other_types(name, [keywords[key] for key in keywords if key == "dtype"])
    words = {key: value for key, value in _plain(keywords).items() if key != "dtype"}
    if name in {"gt", "lt", "ge", "le"} and len(arguments) == 2:
        return elementwise(partial(_flag, name), *arguments)
    if name in {"eq", "ne"} and len(arguments) == 2:
        return _equal(name == "eq", *arguments)
    if name == "pow" and "exponent" in words:
        arguments.append(words.pop("exponent"))
    if name == "add" and len(arguments) == 2 and not words:
        return elementwise(added, *arguments)
    scalar = SCALAR.get(name)
    if scalar is not None and len(arguments) == ARGUMENTS.get(name, 1) and not words:
        return elementwise(scalar, *arguments)
    if name == "where" and len(arguments) == 3:
        return elementwise(_where, *arguments)
    if name in {"clamp", "clip"}:
        return _clamped(*arguments, **words)
    # with a whole number it is an axis, of which torch answers values and indices
    if name in {"min", "max"} and len(arguments) == 2 and not isinstance(arguments[1], int):
        return elementwise(larger if name == "max" else smaller, *arguments)
    if name in {"size", "dim", "numel"} and is_tensor(arguments[0]):
        return _size(name, shape_of(arguments[0]), *arguments[1:], **words)
    moved = MOVES.get(name)
    if moved is None:
        raise NotTranslatedError(f"the call of `torch.{name}`")
    if _has_whole(arguments):
        raise NeedsElementsError
    return moved(*arguments, **words)


def _size(name: str, shape: list[int], dim: int | None = None) -> int | list[int]:
    if name == "dim":
        return len(shape)
    if name == "numel":
        return math.prod(shape)
    return shape if dim is None else shape[dim]


def is_tensor(value: Any) -> bool:
    """True if a value is a tensor: a `Whole`, or an array with a term per element."""
    return isinstance(value, np.ndarray | Whole)


def shape_of(value: Any) -> list[int]:
    """The shape of a tensor."""
    return list(cast("Tensor", value).shape)


def _plain(keywords: Mapping[str, Any]) -> dict[str, Any]:
    words = {arrays.KEYWORDS.get(key, key): value for key, value in keywords.items()}
    return {k: v for k, v in words.items() if k not in {"dtype", "device", "requires_grad"}}


def _has_whole(value: Any) -> bool:
    if isinstance(value, list):
        return any(_has_whole(one) for one in cast("list[Any]", value))
    return isinstance(value, Whole)


def _equal(is_same: bool, left: Any, right: Any) -> Tensor:
    def make(a: Term, b: Term) -> Term:
        # the language has no `==`; of infinite operands this is false, where torch says true
        near = infix("<=", call("abs", infix("-", a, b)), number(0))
        return call("where", near, number(is_same), number(not is_same))

    return elementwise(make, left, right)


def _clamped(value: Any, low: Any = None, high: Any = None, **words: Any) -> Tensor:
    low, high = words.pop("min", low), words.pop("max", high)
    if words:
        raise NotTranslatedError("`clamp` with other arguments")
    if low is not None:
        value = elementwise(larger, value, low)
    if high is not None:
        value = elementwise(smaller, value, high)
    return value
