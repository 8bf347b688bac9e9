"""Removes slices of parameters that are 0, the terms and elements that they make 0, and nodes that
only these use.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Parameter, Program
from compiler.ir.types import Axis
from compiler.passes.analyses.kept_slices import Cut, Kept
from compiler.passes.analyses.selected_elements import Asked, SelectedElements
from compiler.passes.simplify import drop_unused, fold_constants, share_common

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pruned:
    """A smaller program, and the cuts that bring the arrays of weights to its shapes."""

    program: Program
    cuts: tuple[Cut, ...]


def prune_zero_slices(
    program: Program, weights: Mapping[str, FloatArray], arrays: Collection[str]
) -> Pruned:
    """Removes zero terms from sums, and elements of values that are no longer needed.

    A slice of one of the parameters `arrays` counts as zero if all its elements in `weights` are
    exactly 0. An array that is entirely 0 is removed (`drop_zero_numbers`). The new program has the
    same outputs if all values that are multiplied by 0 are finite: 0 · ∞ is also removed.

    Before: window form, no losses. After: the same form. Example, before and after:

        %2: [hid=4] = contract(%1, %0) over t
        %4: scalar = contract(%w, %3) over hid      # hid 1 and 3 of w are 0

        %2: [hid=2] = contract(%1, %0) over t
        %4: scalar = contract(%w, %3) over hid
    """
    values = {name: np.asarray(weights[name], float) for name in arrays if name in weights}
    program = drop_zero_numbers(program, {n for n, value in values.items() if not value.any()})
    values = {name: value for name, value in values.items() if _has_zero_slice(value)}
    if not values.keys() & {parameter.name for parameter in program.parameters}:
        return Pruned(program, ())
    asked: Asked = {}
    step = SelectedElements(program.step, values, _roots(program), asked)
    start = SelectedElements(program.start, values, [s.start for s in program.states], asked)
    # an array is cut only if all its readers agree: a file of weights has one shape
    cuts = {
        place: next(iter(kept))
        for place, kept in asked.items()
        if len(kept) == 1 and None not in kept
    }
    chosen = {place: kept for place, kept in cuts.items() if kept is not None}
    small = replace(program, expected=())
    small = with_step(small, *step.rebuilt(chosen))
    small = with_start(small, *start.rebuilt(chosen))
    parameters = tuple(_cut(parameter, chosen) for parameter in program.parameters)
    # only values that are still whole keep their expected ranges
    small = replace(small, parameters=parameters, expected=step.expected(program.expected))
    # inserted zeros may now be folded
    small = drop_unused(share_common(fold_constants(small)))
    left = {parameter.name for parameter in small.parameters}
    found = [
        Cut(name, at, program.parameter(name).axes[at].size, kept)
        for (name, at), kept in chosen.items()
        if name in left
    ]
    return Pruned(small, tuple(found))


def _has_zero_slice(value: FloatArray) -> bool:
    return any(
        not np.moveaxis(value != 0.0, at, 0).reshape(size, -1).any(axis=1).all()
        for at, size in enumerate(value.shape)
    )


def _roots(program: Program) -> list[NodeId]:
    states = [state.next for state in program.states]
    return [*states, *(output.node for output in program.outputs)]


def _cut(parameter: Parameter, cuts: Mapping[tuple[str, int], Kept]) -> Parameter:
    values = np.reshape(parameter.initial, [axis.size for axis in parameter.axes])
    axes = list(parameter.axes)
    for at, axis in enumerate(parameter.axes):
        kept = cuts.get((parameter.name, at))
        if kept is not None:
            values = np.take(values, kept, axis=at)
            axes[at] = Axis(axis.name, len(kept))
    return replace(parameter, axes=tuple(axes), initial=tuple(values.ravel().tolist()))


def drop_zero_numbers(program: Program, names: Collection[str]) -> Program:
    """Removes the parameters `names`, whose elements are all 0: products with them become 0, and
    sums lose such terms.

    The new program has the same outputs if all values that are multiplied by 0 are finite: 0 · ∞ is
    also removed.

    Before: window form. After: the same form. Example, before and after:

        %2: scalar = %k * %x                       # k is 0
        %4: scalar = %3 + %2

        %3: scalar = …                             # replaces %4
    """
    if not names:
        return program
    program = with_step(program, *_dropped(program.step, names))
    return drop_unused(with_start(program, *_dropped(program.start, names)))


def _dropped(graph: Graph, names: Collection[str]) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    zero: set[NodeId] = set()
    for index, node in graph:
        of = [arg in zero for arg in node.args]
        with builder.at(node.span):
            if _is_zero(node, of, names):
                zero.add(index)
                number = builder.constant(0.0, unit=node.type.unit)
                copies[index] = builder.broadcast(number, node.type.axes)
                continue
            args = tuple(copies[arg] for arg in node.args)
            match node.op:
                case ops.Add() if any(of):
                    # one operand remains: adding 0 would only change −0 to +0
                    copies[index] = args[of.index(False)]
                case ops.Subtract() if any(of):
                    copies[index] = args[0] if of[1] else builder.negate(args[1])
                case _:
                    copies[index] = copy_node(builder, node, args)
    return builder.graph(), copies


def _is_zero(node: Node, of: list[bool], names: Collection[str]) -> bool:
    """True if the value of a node is 0 because the parameters `names` are 0; `of` has one flag per
    operand, True for a zero one.
    """
    match node.op:
        case ops.ReadParameter(name):
            return name in names
        # every term of a contraction has a factor from the array, which is entirely 0
        case ops.Multiply() | ops.Contract():
            return any(of)
        # 0/x is 0, even if x can be 0: values are assumed finite
        case ops.Divide():
            return of[0]
        case (
            ops.Add()
            | ops.Subtract()
            | ops.Negate()
            | ops.Identity()
            | ops.Sum()
            | ops.Broadcast()
            | ops.Reshape()
            | ops.Slice()
            | ops.Concat()
        ):
            return all(of)
        case _:
            # exp(0), for instance, is 1
            return False
