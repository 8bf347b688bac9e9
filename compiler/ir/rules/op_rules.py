"""Checks each node: the operands and the type that its operation requires."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

from compiler.ir import ops
from compiler.ir.program import Node
from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from compiler.ir.types import WINDOW, Axis, Type, describe_axes
from spec_schema.late_dataclass import dataclass

LARGEST_SIZE = 1 << 24
"""Maximum number of scalars in one value: 128 MiB in float64."""
MOST_AXES = 12
LONGEST_NAME = 2000
FARTHEST_SAMPLE = 1 << 24
"""Maximum distance, in samples, between t and a sample that a program reads."""


def broken_axes(axes: tuple[Axis, ...]) -> str | None:
    """Returns the reason why these axes are illegal, or None."""
    if not axes:
        return None
    names = [axis.name for axis in axes]
    if len(set(names)) != len(names):
        return f"{describe_axes(axes)} has an axis twice"
    if any(_is_no_name(name) for name in names):
        return "an axis has no proper name"
    # the window is last (R1): backends rely on the position of the newest sample
    if WINDOW in names[:-1]:
        return f"{describe_axes(axes)} has the window before the end"
    if len(axes) > MOST_AXES or any(axis.size < 1 for axis in axes):
        return f"{describe_axes(axes)} has too many axes or an empty one"
    # checked before memory is allocated: a file may contain any length
    if math.prod(axis.size for axis in axes) > LARGEST_SIZE:
        return f"{describe_axes(axes)} has more than {LARGEST_SIZE} elements"
    return None


def broken_rule(node: Node, operands: tuple[Type, ...], sources: AxesOfSources) -> str | None:
    """Returns the reason why a node is illegal for operands of these types, or None.

    Units are not checked: they are labels, which the front end has checked.
    """
    type, axes = node.type, node.type.axes
    reason = broken_axes(axes) or _wrong_count(node, operands)
    if reason is not None:
        return reason
    match node.op:
        case ops.Constant(name=name) if name and _is_no_name(name):
            return "a constant has no proper name"
        case ops.Constant(values):
            # no infinite constants: JSON has none; a model that needs one divides by 0
            if len(values) != type.size or not all(math.isfinite(value) for value in values):
                return f"{len(values)} numbers for {describe_axes(axes)}, or one is not finite"
            return _real(type)
        case ops.ReadParameter(name):
            return _from(f"parameter `{name}`", sources.parameters.get(name), type)
        case ops.ReadState(name):
            return _from(f"state `{name}`", sources.states.get(name), type)
        case ops.ReadSignal(name, first, last) | ops.ReadLog(name, first, last):
            return _read(sources.signals.get(name), name, first, last, type)
        # only graphs that training derives may read such values
        case ops.ReadTraining():
            return "a program reads no value of training"
        case ops.Dropout(rate) if not 0 <= rate < 1:
            return f"a share of {rate} cannot be left out"
        case ops.Named(name) if _is_no_name(name):
            return "a value is named by no proper name"
        case ops.Named():
            fits = operands[0].kind == type.kind
            return _elementwise(type, operands) or (None if fits else "a name changes no kind")
        case ops.Apply(function) if function not in SCALAR_FUNCTIONS:
            return f"there is no function `{function}`"
        case ops.Compare():
            reason = _elementwise(type, operands) or _real(*operands)
            return reason or (None if type.kind == "bool" else "a comparison is a bool")
        case ops.Select():
            if operands[0].kind != "bool":
                return "the condition is not a bool"
            return _elementwise(type, operands) or _real(type, *operands[1:])
        case ops.Elementwise():
            return _elementwise(type, operands) or _real(type, *operands)
        case ops.Broadcast():
            fits = set(operands[0].axes) <= set(axes) and operands[0].kind == type.kind
            return None if fits else f"{describe_axes(operands[0].axes)} does not fit in the result"
        case ops.Reshape():
            fits = operands[0].size == type.size and operands[0].kind == type.kind
            return None if fits else f"{describe_axes(operands[0].axes)} has another size"
        case ops.Slice(axis, start, stop):
            return _sliced(operands[0], axis, start, stop, type)
        case ops.Concat(axis):
            return _joined(operands, axis, type)
        case ops.Sum(axis):
            rest = tuple(a for a in operands[0].axes if a.name != axis)
            fits = operands[0].axis(axis) is not None and rest == axes
            return _real(type, *operands) or (None if fits else f"not the sum over `{axis}`")
        case ops.Contract(axis):
            return _real(type, *operands) or _contracted(operands[0], operands[1], axis, axes)
        case ops.Window(state):
            return _windowed(sources.states.get(state), operands[0], state, type)
        case _:
            assert_never(node.op)


@dataclass(frozen=True, slots=True)
class AxesOfSources:
    """Axes of the signals, parameters and states that a graph may read, by name."""

    signals: Mapping[str, tuple[Axis, ...]]
    parameters: Mapping[str, tuple[Axis, ...]]
    states: Mapping[str, tuple[Axis, ...]]


def _is_no_name(name: str) -> bool:
    return len(name) > LONGEST_NAME or not name.isprintable()


def _wrong_count(node: Node, operands: tuple[Type, ...]) -> str | None:
    match node.op:
        case ops.Apply(function):
            row = SCALAR_FUNCTIONS.get(function)
            count = row.arity if row is not None else len(operands)
        case ops.Concat():
            count = max(len(operands), 1)
        case _:
            count = node.op.arity
    return None if len(operands) == count else f"{len(operands)} operands, not {count}"


def _real(*types: Type) -> str | None:
    for type in types:
        if type.kind != "real":
            return "a bool where a number belongs"
    return None


def _elementwise(type: Type, operands: tuple[Type, ...]) -> str | None:
    for operand in operands:
        if operand.axes != type.axes:
            return f"an operand has axes {describe_axes(operand.axes)}"
    return None


def _from(what: str, axes: tuple[Axis, ...] | None, type: Type) -> str | None:
    if axes is None:
        return f"there is no {what}"
    if axes != type.axes:
        return f"{what} has axes {describe_axes(axes)}"
    return _real(type)


def _read(
    axes: tuple[Axis, ...] | None, name: str, first: int, last: int, type: Type
) -> str | None:
    if axes is None:
        return f"there is no signal `{name}`"
    if not -FARTHEST_SAMPLE <= first <= last <= FARTHEST_SAMPLE:
        return f"samples {first} … {last} are no window"
    # a window of length 1 has a window axis; a single sample has none
    window = (Axis(WINDOW, last - first + 1),) if type.window is not None else ()
    if not window and first != last:
        return "several samples need a window axis"
    return _from(f"signal `{name}`", (*axes, *window), type)


def _sliced(operand: Type, axis: str, start: int, stop: int, type: Type) -> str | None:
    whole = operand.axis(axis)
    if whole is None or not 0 <= start < stop <= whole.size:
        return f"`{axis}` {start}:{stop} is no part of {describe_axes(operand.axes)}"
    part = tuple(Axis(axis, stop - start) if a.name == axis else a for a in operand.axes)
    return None if part == type.axes and operand.kind == type.kind else "not the slice's axes"


def _joined(operands: tuple[Type, ...], axis: str, type: Type) -> str | None:
    parts = [operand.axis(axis) for operand in operands]
    size = sum(part.size for part in parts if part is not None)
    for operand, part in zip(operands, parts, strict=True):
        longer = tuple(Axis(axis, size) if a.name == axis else a for a in operand.axes)
        if part is None or longer != type.axes or operand.kind != type.kind:
            return f"{describe_axes(operand.axes)} does not join along `{axis or '_'}`"
    return None


def _contracted(left: Type, right: Type, axis: str, axes: tuple[Axis, ...]) -> str | None:
    mine, partner = left.axis(axis), right.axis(axis)
    if mine is None or mine != partner:
        return f"`{axis or '_'}` is not an axis of equal length on both sides"
    rest = {a for a in (*left.axes, *right.axes) if a.name != axis}
    return None if rest == set(axes) else "not the axes of both without the contracted one"


def _windowed(state: tuple[Axis, ...] | None, newest: Type, name: str, type: Type) -> str | None:
    if state is None or not state or state[-1].name != WINDOW:
        return f"there is no buffer `{name}`"
    grown = (*newest.axes, Axis(WINDOW, state[-1].size + 1))
    if newest.axes != state[:-1] or type.axes != grown:
        return f"buffer `{name}` has axes {describe_axes(state)}"
    return _real(type, newest)
