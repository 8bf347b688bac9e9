"""Torch code of operations that need several calls: broadcast, contract, concat, sums."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import fx

from compiler.ir.ops import Relation
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Axis, Type

RELATIONS: dict[Relation, Callable[..., Any]] = {
    Relation.LESS: torch.lt,
    Relation.LESS_EQUAL: torch.le,
    Relation.GREATER: torch.gt,
    Relation.GREATER_EQUAL: torch.ge,
}

NATIVE_FUNCTIONS: frozenset[str] = frozenset(
    {name for name, row in SCALAR_FUNCTIONS.items() if row.torch} | {"softplus"}
)
"""Scalar functions that torch has; others are first expanded by their definition."""


def scalar_function(code: fx.Graph, name: str, args: Sequence[fx.Node]) -> fx.Node:
    """Applies a scalar function of the table to every element."""
    if name == "softplus":  # log(exp(x) + exp(0)): exact tails, and derivative 1/2 at 0
        zero = code.call_function(torch.zeros_like, (args[0],))
        return code.call_function(torch.logaddexp, (args[0], zero))
    value = code.call_function(getattr(torch, SCALAR_FUNCTIONS[name].torch), tuple(args))
    if name == "sign":  # torch gives 0 for NaN
        missing = code.call_function(torch.isnan, (args[0],))
        return code.call_function(torch.where, (missing, args[0], value))
    return value


def broadcast(
    code: fx.Graph, value: fx.Node, old: tuple[Axis, ...], new: tuple[Axis, ...], static: bool
) -> fx.Node:
    """The value, permuted to the order of the new axes and repeated along missing ones."""
    batch = 0 if static else 1
    names = [axis.name for axis in old]
    kept = [axis.name for axis in new if axis.name in names]
    if kept != names:
        order = [names.index(name) + batch for name in kept]
        # the batch stays first
        value = code.call_function(torch.permute, (value, (*range(batch), *order)))
    for position, axis in enumerate(new):
        if axis.name not in names:
            value = code.call_function(torch.unsqueeze, (value, position + batch))
    return _expanded(code, value, tuple(axis.size for axis in new), batch)


def _expanded(code: fx.Graph, value: fx.Node, shape: tuple[int, ...], batch: int) -> fx.Node:
    return code.call_method("expand", (value, *((-1,) * batch), *shape))


def expand_static(code: fx.Graph, value: fx.Node, type: Type, batched: fx.Node) -> fx.Node:
    """A tensor without batch axis, repeated along the batch of another tensor."""
    batch = code.call_method("size", (batched, 0))
    return code.call_method("expand", (value, batch, *type.shape))


def concat(
    code: fx.Graph,
    args: Sequence[fx.Node],
    types: Sequence[Type],
    static: Sequence[bool],
    dim: int,
) -> fx.Node:
    """Concatenates the operands along `dim`, counted from the end."""
    # torch.cat does not broadcast: repeat static operands along the batch
    batched = next((arg for arg, fixed in zip(args, static, strict=True) if not fixed), None)
    if batched is not None:
        args = [
            expand_static(code, arg, type, batched) if fixed else arg
            for arg, type, fixed in zip(args, types, static, strict=True)
        ]
    return code.call_function(torch.cat, (list(args), dim))


def sum_axis(code: fx.Graph, value: fx.Node, type: Type, axis: str) -> fx.Node:
    """Σ over one axis; a batch axis comes before those of the type."""
    return code.call_function(torch.sum, (value, type.position(axis) - len(type.axes)))


def contract(
    code: fx.Graph,
    args: Sequence[fx.Node],
    types: Sequence[Type],
    static: Sequence[bool],
    axis: str,
    result: Type,
) -> fx.Node:
    """Σ over one axis of the product of two operands, by the cheapest call."""
    left, right = types
    flat = [len(type.axes) == 1 for type in types]
    # a static vector on one side: a matrix product, for any axes of the other operand
    if flat[1] and static[1] and left.position(axis) == len(left.axes) - 1:
        return code.call_function(torch.matmul, (args[0], args[1]))
    if flat[0] and static[0] and right.position(axis) == len(right.axes) - 1:
        return code.call_function(torch.matmul, (args[1], args[0]))
    if flat == [True, True]:
        return code.call_function(
            torch.sum, (code.call_function(torch.mul, (args[0], args[1])), -1)
        )
    return code.call_function(torch.einsum, (_formula(types, static, result), *args))


def _formula(types: Sequence[Type], static: Sequence[bool], result: Type) -> str:
    """Einstein summation over named axes; `z` is the batch."""
    letters: dict[str, str] = {}
    for type in types:
        for axis in type.axes:
            # einsum names axes by letters; `z` is the batch
            letters.setdefault(axis.name, "abcdefghijklmnopqrstuvwxy"[len(letters)])
    terms = [
        ("" if fixed else "z") + "".join(letters[axis.name] for axis in type.axes)
        for type, fixed in zip(types, static, strict=True)
    ]
    batch = "" if all(static) else "z"
    return f"{','.join(terms)}->{batch}{''.join(letters[axis.name] for axis in result.axes)}"
