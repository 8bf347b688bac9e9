"""Computes initial values of arrays: numbers, index formulas, random draws, profiles, files."""

from __future__ import annotations

import numpy as np

from compiler.ir.scalars.table import Array
from compiler.ir.types import Axis, describe_axes
from compiler.lowering.arrays.named_draws import generator_of, uniform_draws
from compiler.lowering.arrays.number_file import UnusableFileError, read_numbers
from compiler.lowering.constants import evaluate, refuse_infinite, shaped
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart, FunctionArgument
from compiler.lowering.failure import LoweringFailed
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, shapes
from spec_schema.expressions.language import INDICES, LENGTH
from spec_schema.expressions.tree import Expression, Name
from spec_schema.fields.located import Located
from spec_schema.sections.values import (
    ExpInitializer,
    Initializer,
    LinInitializer,
    NegexpInitializer,
    NormalInitializer,
    Shaped,
    UniformInitializer,
)


def initial_values(
    context: Context, name: str, initializer: Initializer, axes: tuple[Axis, ...]
) -> Array:
    """The values of `init:` in the shape of the axes.

    Random draws depend on the array's name only.
    """
    # a profile or a draw between finite limits can overflow
    with np.errstate(all="ignore"):
        values = _chosen(context, name, initializer, axes)
    refuse_infinite(context, f"`{name}`", values, initializer.place.value)
    return values


def _chosen(context: Context, name: str, initializer: Initializer, axes: tuple[Axis, ...]) -> Array:
    shape = tuple(axis.size for axis in axes)
    match initializer.choice:
        case NormalInitializer() as normal:
            return generator_of(name, context.draw).normal(normal.mean, normal.std, shape)
        case UniformInitializer() as uniform:
            return uniform_draws(name, uniform.min, uniform.max, shape, context.draw)
        case ExpInitializer() | NegexpInitializer() | LinInitializer() as shaped:
            position = _position(context, name, shaped, axes)
            # the profile runs along one axis and is repeated along all others
            along = [1] * len(axes)
            along[position : position + 1] = shape[position : position + 1]
            count = shape[position] if axes else 1
            return np.broadcast_to(_profile(shaped, count).reshape(along), shape)
        case Located() as file:
            return _from_file(context, file, axes)
        case expression:
            return _of_index(context, name, expression, axes)


def _position(context: Context, name: str, shaped: Shaped, axes: tuple[Axis, ...]) -> int:
    """The index of the axis along which the values change: the named axis, by default the last."""
    if shaped.along is None:
        return max(len(axes) - 1, 0)
    for position, axis in enumerate(axes):
        if axis.name == shaped.along.value:
            return position
    context.findings.report(
        shapes.no_such_axis(name, shaped.along.value, describe_axes(axes), shaped.along.span)
    )
    raise LoweringFailed


def _profile(shaped: Shaped, count: int) -> Array:
    """The values at x = 0 … 1, from first to last index. A single element is the named end."""
    x = np.arange(count) / max(count - 1, 1)
    match shaped:
        case ExpInitializer(first=first, rate=rate):
            return first * np.exp(-rate * x)
        case NegexpInitializer(last=last, rate=rate):
            return last * np.exp(-rate * (1 - x if count > 1 else 0 * x))
        case LinInitializer(first=first, last=last):
            return first + (last - first) * x


def _of_index(context: Context, name: str, expression: Expression, axes: tuple[Axis, ...]) -> Array:
    """Evaluates a list, which fills the array in order, or an index formula, aligned by name."""
    found = evaluate(context, expression, _with_indices(context, name, axes, expression.span))
    if axes and found.axes and set(found.axes) <= set(axes):
        order = [found.axes.index(axis) for axis in axes if axis in found.axes]
        shape = [axis.size if axis in found.axes else 1 for axis in axes]
        values = found.values.transpose(order).reshape(shape)
        full = np.broadcast_to(values, [axis.size for axis in axes])
        return shaped(context, name, full, axes, expression.span)
    return shaped(context, name, found.values, axes, expression.span)


def _with_indices(context: Context, array: str, axes: tuple[Axis, ...], span: Span) -> Environment:
    """The environment of an index formula: constants, and index names that the spec does not
    declare.

    Names that a sub-model declares contain a dot, so a bare name in it is always an index.
    """
    plain = Environment(EnvironmentPart.CONSTANT)
    if not axes:
        return plain
    builder = context.builder(plain)
    values = {
        index: builder.constant(np.arange(axis.size), (axis,))
        # the language has index names for the first axes only
        for index, axis in zip(INDICES, axes, strict=False)
    }
    values[LENGTH] = builder.constant(axes[-1].size)
    arguments = {
        name: FunctionArgument(Name(name, span), plain, {plain.time: node}, at_hand=True)
        for name, node in values.items()
        if name not in context.scope or context.is_of_submodel(array)
    }
    return Environment(EnvironmentPart.CONSTANT, arguments=arguments)


def _from_file(context: Context, file: Located[str], axes: tuple[Axis, ...]) -> Array:
    """Reads the values from a file with one row per index of the axes before the last."""
    try:
        numbers = read_numbers(file.value, file.span.file, context.numbers)
    except UnusableFileError as error:
        context.findings.report(names.unusable_numbers(file.value, str(error), file.span))
        raise LoweringFailed from None
    shape = tuple(axis.size for axis in axes)
    rows = (int(np.prod(shape[:-1], dtype=int)), shape[-1]) if axes else (1, 1)
    # a vector may be written as one row or as one column
    if numbers.shape != rows and not (rows[0] == 1 and numbers.shape == rows[::-1]):
        found, needed = _described(numbers.shape), _described(rows)
        reason = f"it has {found}, and {describe_axes(axes)} needs {needed}"
        context.findings.report(names.unusable_numbers(file.value, reason, file.span))
        raise LoweringFailed
    return numbers.reshape(shape)


def _described(rows: tuple[int, ...]) -> str:
    return f"{rows[0]} rows of {rows[1]} numbers" if rows[0] > 1 else f"{rows[1]} numbers"
