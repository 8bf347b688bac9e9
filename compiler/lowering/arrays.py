"""Creates the parameters of the program, those of `parameters:` and the arrays of layers, with
axes, units, initial values and bounds.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId, Parameter, Prior, Statistic
from compiler.ir.scalars import Array
from compiler.ir.types import Axis, Type, describe_axes
from compiler.lowering.constants import evaluate, limit_in, refuse_infinite, shaped, width_in
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment, EnvironmentPart, FunctionArgument
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, shapes
from spec_schema.expressions.language import INDICES, LENGTH
from spec_schema.expressions.tree import Expression, Name
from spec_schema.fields.leaf import Located
from spec_schema.reading.reader import is_near, refuse_endless
from spec_schema.sections.values import (
    ExpInitializer,
    Initializer,
    LinInitializer,
    NegexpInitializer,
    NormalInitializer,
    Shaped,
    UniformInitializer,
)
from spec_schema.sections.values import Parameter as ParameterEntry
from spec_schema.sections.values import Prior as PriorEntry
from spec_schema.units.unit import Unit


class Arrays:
    """The learnable arrays of one compilation: entries of `parameters:`, and arrays of layers. Each
    is declared at its first use.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._parameters: dict[str, Parameter] = {}
        self._failed: set[str] = set()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the program, in the order of first use, without frozen ones."""
        return tuple(p for p in self._parameters.values() if not self._is_constant(p))

    @property
    def all_names(self) -> tuple[str, ...]:
        """Names of all parameters used so far, including those that a frozen sub-model makes
        constant.
        """
        return tuple(self._parameters)

    def of_layer(self, layer: str) -> tuple[str, ...]:
        """Names of the arrays that the layer `layer` has declared so far, without the prefix
        `layer.`.
        """
        owners = (name.rpartition(".") for name in self._parameters)
        return tuple(suffix for owner, _, suffix in owners if owner == layer)

    def read(self, builder: GraphBuilder, name: str) -> NodeId:
        """The node that reads the parameter `name`; a constant node if its sub-model is frozen
        (R11). Raises KeyError if the parameter has not been declared.
        """
        parameter = self._parameters[name]
        if not self._is_constant(parameter):
            return builder.parameter(name, Type(parameter.axes, parameter.unit))
        node = builder.constant(parameter.initial, parameter.axes, parameter.unit)
        builder.name(node, name)
        return node

    # ---- entries

    def parameter(self, name: str, entry: ParameterEntry) -> Type:
        """The type of the `parameters:` entry `name`; declares the parameter at its first use.
        Reports invalid initial values or bounds and raises LoweringFailed, also at each later use.
        """
        if name in self._failed:
            raise LoweringFailed
        if name not in self._parameters:
            # the name stays if declaring raises: a mistake is reported at the first use only
            self._failed.add(name)
            self._parameters[name] = self._with_given(self._declared(name, entry))
            self._failed.remove(name)
        declared = self._parameters[name]
        return Type(declared.axes, declared.unit)

    def _declared(self, name: str, entry: ParameterEntry) -> Parameter:
        axes = self._context.axes_of(entry)
        unit = entry.unit.value if entry.unit else None
        initial = initial_values(self._context, name, entry.init, axes)
        low = None if entry.min is None else limit_in(self._context, entry.min, unit)
        high = None if entry.max is None else limit_in(self._context, entry.max, unit)
        span = entry.init.place.value
        if low is not None and high is not None and low >= high:
            assert entry.min is not None
            self._context.findings.report(
                names.unfit_constant(
                    f"`{name}`", "has no room: `min` is not below `max`", entry.min.span
                )
            )
            raise LoweringFailed
        outside = bool(
            (low is not None and np.any(initial < low))
            or (high is not None and np.any(initial > high))
        )
        if outside:
            least = "-inf" if low is None else f"{low:g}"
            most = "inf" if high is None else f"{high:g}"
            problem = f"must lie within its bounds {least} … {most}"
            self._context.findings.report(names.unfit_constant(f"`{name}`", problem, span))
            raise LoweringFailed
        return Parameter(
            name=name,
            axes=axes,
            unit=unit,
            initial=tuple(float(v) for v in initial.ravel()),
            minimum=low,
            maximum=high,
            scale=1.0 if entry.scale is None or entry.scale == "data" else entry.scale,
            learn=entry.learn,
            scales_by_data=entry.scale == "data",
            prior=self._prior(entry.prior, unit),
            doc=entry.doc or "",
            span=entry.place.key,
        )

    def _prior(self, entry: PriorEntry | None, unit: Unit | None) -> Prior | None:
        if entry is None:
            return None
        return Prior(
            limit_in(self._context, entry.mean, unit), width_in(self._context, entry.std, unit)
        )

    def declare(
        self,
        name: str,
        axes: tuple[Axis, ...],
        initial: Array,
        unit: Unit | None,
        doc: str,
        span: Span,
        bounds: tuple[float | None, float | None],
        statistic: Statistic | None = None,
    ) -> Type:
        """Declares an array of a layer at its first use, and returns its type. `initial` are its
        values in the shape of `axes`, `bounds` minimum and maximum (None for none), `doc` describes
        it.

        The array is learned, unless training computes it from the data as `statistic`.
        """
        parameter = self._parameters.get(name)
        if parameter is None:
            values = tuple(float(v) for v in initial.ravel())
            low, high = bounds
            learn = statistic is None
            parameter = Parameter(
                name=name,
                axes=axes,
                unit=unit,
                initial=values,
                minimum=low,
                maximum=high,
                scale=1.0,
                learn=learn,
                statistic=statistic,
                doc=doc,
                span=span,
            )
            parameter = self._parameters[name] = self._with_given(parameter)
        return Type(parameter.axes, parameter.unit)

    def _with_given(self, parameter: Parameter) -> Parameter:
        """The parameter, with the initial values from `weights:` of its sub-model if these contain
        it.
        """
        shape = tuple(axis.size for axis in parameter.axes)
        given = self._context.given.value(parameter.name, shape)
        if given is None:
            return parameter
        values = tuple(float(value) for value in given.ravel())
        return replace(parameter, initial=values, statistic=None)  # the weights contain it

    def _is_constant(self, parameter: Parameter) -> bool:
        """True if `freeze:` of its sub-model makes the parameter a constant.

        A statistic of the data that no weights contain is none, since its value is not known yet.
        """
        return parameter.statistic is None and self._context.given.is_frozen(parameter.name)


def initial_values(
    context: Context, name: str, initializer: Initializer, axes: tuple[Axis, ...]
) -> Array:
    """The values of `initializer`, the `init:` of the array `name`, in the shape of `axes`. Reports
    unusable ones and raises LoweringFailed.

    Random values depend on the array's name and the draw of the compilation only.
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
    """The index of the axis along which the profile `shaped` of an `init:` varies: the axis that it
    names, by default the last. Reports an unknown name and raises LoweringFailed.
    """
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
    """`count` values of the profile `shaped` at x = 0 … 1, evenly spaced: first·e^(−rate·x),
    last·e^(−rate·(1−x)) or a line from first to last. A single element is `first`, or `last` if the
    profile names only that.
    """
    x = np.arange(count) / max(count - 1, 1)
    match shaped:
        case ExpInitializer(first=first, rate=rate):
            return first * np.exp(-rate * x)
        case NegexpInitializer(last=last, rate=rate):
            return last * np.exp(-rate * (1 - x if count > 1 else 0 * x))
        case LinInitializer(first=first, last=last):
            return first + (last - first) * x


def _of_index(context: Context, name: str, expression: Expression, axes: tuple[Axis, ...]) -> Array:
    """The values of an `init:` expression in the shape of `axes`: a list, which fills the array in
    order, or a formula of indices, whose axes are matched by name. Raises LoweringFailed after a
    report.
    """
    found = evaluate(context, expression, _with_indices(context, name, axes, expression.span))
    if axes and found.axes and set(found.axes) <= set(axes):
        order = [found.axes.index(axis) for axis in axes if axis in found.axes]
        shape = [axis.size if axis in found.axes else 1 for axis in axes]
        values = found.values.transpose(order).reshape(shape)
        full = np.broadcast_to(values, [axis.size for axis in axes])
        return shaped(context, name, full, axes, expression.span)
    return shaped(context, name, found.values, axes, expression.span)


def _with_indices(context: Context, array: str, axes: tuple[Axis, ...], span: Span) -> Environment:
    """The environment of an `init:` formula: constants, and the names of indices, unless the spec
    declares an entry of that name.

    Names that a sub-model declares contain a dot, so a bare name in the formula of its array is
    always an index.
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
    """Reads the values from a file with one row per index of the axes before the last. Reports an
    unusable file or a wrong number of values and raises LoweringFailed.
    """
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


def uniform_draws(name: str, low: float, high: float, shape: Sequence[int], draw: int = 0) -> Array:
    """Uniform random values in [low, high), an array of this shape; they depend on `name` and
    `draw` only.

    The scaling is written out, since some compilers fuse multiplication and addition in numpy's
    own.
    """
    return low + (high - low) * generator_of(name, draw).random(tuple(shape))


def generator_of(name: str, draw: int = 0) -> np.random.Generator:
    """A counter-based random generator (Philox; Salmon et al. 2011), seeded by the array's name and
    the number `draw`.

    A name of a spec has no space, so the key `name draw` cannot collide with another name.
    """
    digest = hashlib.sha256((f"{name} {draw}" if draw else name).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:8], "little")))


LARGEST_FILE = 20_000_000
"""Maximum size in bytes; it holds several times more values than the largest array of a program."""

_QUOTED = 40
"""Maximum number of characters of a cell that a message quotes."""
# blanks next to a comma are part of the separator: `1, 2` has no empty cell
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


class UnusableFileError(Exception):
    """Raised for a file without usable numbers; the message is the end of a sentence about the
    file.
    """


def read_numbers(path: str, beside: str, texts: Mapping[str, str]) -> Array:
    """Reads a text file as an array (rows, columns). A relative path starts at the folder of the
    spec `beside`.

    Commas, semicolons or blanks separate the values of a row. Empty lines and comments (`# …`) are
    skipped. `texts` maps paths to contents that were read before. Raises UnusableFileError if the
    file is missing or has no usable numbers.
    """
    rows: list[list[float]] = []
    file = number_path(path, beside)
    text = texts[file] if file in texts else number_text(file)
    quotes = is_near(file, beside)
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#", 1)[0].strip()
        if not content:
            continue
        row = [_number_of_cell(cell, number, quotes=quotes) for cell in _SEPARATOR.split(content)]
        if rows and len(row) != len(rows[0]):
            reason = f"line {number} has {len(row)} numbers, the first row {len(rows[0])}"
            raise UnusableFileError(reason)
        rows.append(row)
    if not rows:
        raise UnusableFileError("it has no numbers")
    return np.array(rows)


def number_path(path: str, beside: str) -> str:
    """The path of a file that a spec names; a relative `path` starts at the folder of the spec
    `beside`.
    """
    return os.path.normpath(Path(beside).parent / path)


def number_text(path: str) -> str:
    """The text of the file `path`. Raises UnusableFileError if it is missing, too large
    or no text.
    """
    if "\0" in path:
        raise UnusableFileError("that is no path")
    file = Path(path)
    try:
        if not file.is_file():  # a pipe or a device would never end
            raise UnusableFileError("it is a folder" if file.is_dir() else "there is no such file")
        refuse_endless(file)
        size = file.stat().st_size
        if size > LARGEST_FILE:
            raise UnusableFileError(f"it has {size:,} bytes, at most {LARGEST_FILE:,} are read")
        # limited again: the file may have grown; spreadsheets start UTF-8 with a byte order mark
        return file.read_bytes()[:LARGEST_FILE].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UnusableFileError("it is not UTF-8 text") from None
    except OSError as error:
        raise UnusableFileError((error.strerror or str(error)).lower()) from None


def _number_of_cell(cell: str, line: int, *, quotes: bool) -> float:
    shown = repr(cell[:_QUOTED]) if quotes else "a cell"
    try:
        value = float(cell)
    except ValueError:
        raise UnusableFileError(f"{shown} in line {line} is no number") from None
    if not math.isfinite(value):
        raise UnusableFileError(f"{cell[:_QUOTED]} in line {line} is not finite")
    return value
