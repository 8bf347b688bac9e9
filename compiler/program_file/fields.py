"""Reads and writes the parts of a program as JSON, derived from the types of their fields.

Each field of a class is one key. Default values are omitted, as are empty axes and units.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field
from enum import Enum, EnumType
from functools import cache
from types import NoneType
from typing import Any, Literal, TypeVar, assert_never, cast, get_args, get_origin, get_type_hints

from compiler.ir.ops import Op, ReadTraining
from compiler.ir.program import (
    Declared,
    Dimension,
    Graph,
    History,
    LayerMemory,
    Loss,
    Node,
    Origin,
    Parameter,
    Tape,
)
from compiler.ir.training.known import Penalty, Prior, Statistic
from compiler.ir.types import Axis, Prediction, Type
from compiler.program_file.plain_data import (
    Malformed,
    PlainRecord,
    as_integer,
    as_number,
    as_pair,
    as_text,
)
from compiler.program_file.unit_data import unit_from_data, unit_to_data
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit

Data = dict[str, Any]
Made = TypeVar("Made")

_ALWAYS = {(Parameter, "initial"), (Loss, "weight"), (Dimension, "labels")}
"""Fields that are written even if they have their default value."""


@dataclass(frozen=True, slots=True)
class Shared:
    """Data that the values of one file share: paths of the specs, and units parsed before."""

    files: tuple[str, ...]
    numbers: Mapping[str, int] = field(default_factory=dict[str, int])
    """Index of each spec by path, for writing."""
    units: dict[str, Unit] = field(default_factory=dict[str, Unit])


def read(make: type[Made], data: Any, place: str, shared: Shared) -> Made:
    """Reads a value of class `make`; `place` is its path in the file. Raises Malformed."""
    record = PlainRecord(data, place)
    made = _read_fields(make, record, shared)
    record.close()
    return made


def to_data(value: object, shared: Shared) -> Data:
    """The keys of a value, from which `read` restores it."""
    data: Data = {}
    for one in _fields(type(value)):
        found = getattr(value, one.name)
        if one.absent is MISSING or found != one.absent:
            written = one.form.write(found, shared)
            data |= written if one.form.has_own_keys else {one.key: written}
    return data


@dataclass(frozen=True, slots=True)
class _Form:
    """Reads and writes values of one type."""

    read: Callable[[PlainRecord, str, Shared], Any]
    """Reads and checks the value under a key of the record."""
    write: Callable[[Any, Shared], Any] = lambda value, shared: value
    has_own_keys: bool = False
    """True if `write` returns keys of the record instead of a single value."""


@dataclass(frozen=True, slots=True)
class _Field:
    name: str
    key: str
    form: _Form
    absent: Any
    """The value that is omitted; MISSING if there is none."""


@cache
def _fields(made: type) -> tuple[_Field, ...]:
    """The fields in the order of the file: `doc` and `span` come last."""
    types = get_type_hints(made)
    # sorting is stable: the other fields keep the order of their class
    fields = sorted(dataclasses.fields(made), key=lambda one: one.name in ("doc", "span"))
    return tuple(
        _Field(
            one.name,
            "at" if one.name == "span" else one.name,
            _form(types[one.name]),
            MISSING if (made, one.name) in _ALWAYS else _EMPTY.get(types[one.name], one.default),
        )
        for one in fields
    )


def _read_fields(make: type[Made], record: PlainRecord, shared: Shared) -> Made:
    return make(
        **{
            one.name: one.form.read(record, one.key, shared)
            if one.absent is MISSING or record.has(one.key)
            else one.absent
            for one in _fields(make)
        }
    )


def _form(type: Any) -> _Form:
    if type in _FORMS:
        return _FORMS[type]
    if get_origin(type) is Literal:
        names = {name: name for name in get_args(type)}
        return _Form(lambda record, key, _: _chosen(record.text(key), record.place, names))
    if isinstance(type, EnumType):
        members = {member.value: member for member in cast("type[Enum]", type)}
        return _Form(
            lambda record, key, _: _chosen(record.text(key), record.place, members),
            lambda member, _: member.value,
        )
    # what is left is `T | None`
    present, nothing = get_args(type)
    assert nothing is NoneType, f"{type} has no form in program files"
    form = _form(present)
    return _Form(
        lambda record, key, shared: form.read(record, key, shared) if record.has(key) else None,
        lambda value, shared: None if value is None else form.write(value, shared),
    )


def _chosen(value: str, place: str, choices: dict[str, Made]) -> Made:
    if value not in choices:
        raise Malformed(f"{place}: {value[:40]!r} is none of {', '.join(choices)}")
    return choices[value]


def _list_of(item: Callable[[Any, str], Any]) -> _Form:
    return _Form(lambda record, key, _: record.items(key, item), lambda items, _: list(items))


# ---- types with a form of their own


def _read_axis(data: Any, place: str) -> Axis:
    name, size = as_pair(data, place)
    return Axis(as_text(name, place), as_integer(size, place))


def _read_unit(record: PlainRecord, key: str, shared: Shared) -> Unit:
    data, place = record.raw(key), f"{record.place}.{key}"
    if not isinstance(data, str):
        return unit_from_data(data, place)
    # files repeat a few units thousands of times, and parsing one is slow
    if data not in shared.units:
        shared.units[data] = unit_from_data(data, place)
    return shared.units[data]


def _read_range(record: PlainRecord, key: str, _: Shared) -> tuple[float, float]:
    low, high = as_pair(record.raw(key), record.place)
    return (
        -math.inf if low is None else as_number(low, record.place),
        math.inf if high is None else as_number(high, record.place),
    )


def _range_to_data(bounds: tuple[float, float], _: Shared) -> list[float | None]:
    """Writes an infinite bound as null."""
    return [bound if math.isfinite(bound) else None for bound in bounds]


def _read_span(record: PlainRecord, key: str, shared: Shared) -> Span:
    numbers = record.items(key, as_integer)
    if len(numbers) != 5 or not 0 <= numbers[0] < len(shared.files):
        raise Malformed(f"{record.place}.{key} is no place in a file")
    file, line, column, end_line, end_column = numbers
    return Span(
        file=shared.files[file], line=line, column=column, end_line=end_line, end_column=end_column
    )


def _span_to_data(span: Span, shared: Shared) -> list[int]:
    return [shared.numbers[span.file], span.line, span.column, span.end_line, span.end_column]


def _read_prediction(record: PlainRecord, key: str, _: Shared) -> Prediction:
    signal, ahead = as_pair(record.raw(key), record.place)
    return Prediction(as_text(signal, record.place), as_integer(ahead, record.place))


def _read_statistic(record: PlainRecord, key: str, _: Shared) -> Statistic:
    kind, signal = as_pair(record.raw(key), record.place)
    kinds: dict[str, Literal["mean", "std"]] = {"mean": "mean", "std": "std"}
    known = _chosen(as_text(kind, record.place), record.place, kinds)
    return Statistic(known, as_text(signal, record.place))


def _read_prior(record: PlainRecord, key: str, _: Shared) -> Prior:
    mean, std = as_pair(record.raw(key), record.place)
    return Prior(as_number(mean, record.place), as_number(std, record.place))


def _read_penalty(record: PlainRecord, key: str, _: Shared) -> Penalty:
    parameter, over = as_pair(record.raw(key), record.place)
    axis = None if over is None else as_text(over, record.place)
    return Penalty(as_text(parameter, record.place), axis)


_MEMORIES = {"of the run": True, "of the past": False}


def _read_origin(record: PlainRecord, key: str, shared: Shared) -> Origin:
    if record.has("memory"):
        return LayerMemory(_chosen(record.text("memory"), record.place, _MEMORIES))
    if record.has("history"):
        return History(record.text("history"))
    if record.has("tape"):
        # a tape is written like a prediction: a signal and how far ahead
        found = _read_prediction(record, "tape", shared)
        return Tape(found.signal, found.ahead)
    return Declared()


def _origin_to_data(origin: Origin, _: Shared) -> Data:
    match origin:
        case Declared():
            return {}
        case LayerMemory(starts_fresh_each_run):
            return {"memory": "of the run" if starts_fresh_each_run else "of the past"}
        case History(source):
            return {"history": source}
        case Tape(signal, ahead):
            return {"tape": [signal, ahead]}
        case _:
            assert_never(origin)


_OPS: dict[str, type[Op]] = {op.__name__: op for op in get_args(Op) if op is not ReadTraining}


def _read_op(record: PlainRecord, key: str, shared: Shared) -> Op:
    return _read_fields(_chosen(record.text(key), record.place, _OPS), record, shared)


def _read_graph(record: PlainRecord, key: str, shared: Shared) -> Graph:
    return Graph(record.items(key, lambda data, place: read(Node, data, place, shared)))


_EMPTY: dict[Any, Any] = {tuple[Axis, ...]: (), tuple[int, ...]: (), Unit | None: None}
"""Values that are omitted although the field has no default."""

_FORMS: dict[Any, _Form] = {
    str: _Form(lambda record, key, _: record.text(key)),
    int: _Form(lambda record, key, _: record.integer(key)),
    float: _Form(lambda record, key, _: record.number(key)),
    bool: _Form(lambda record, key, _: record.truth(key)),
    tuple[str, ...]: _list_of(as_text),
    tuple[int, ...]: _list_of(as_integer),
    tuple[float, ...]: _list_of(as_number),
    tuple[float, float]: _Form(_read_range, _range_to_data),
    tuple[Axis, ...]: _Form(
        lambda record, key, _: record.items(key, _read_axis),
        lambda axes, _: [[axis.name, axis.size] for axis in axes],
    ),
    Unit: _Form(_read_unit, lambda unit, _: unit_to_data(unit)),
    Span: _Form(_read_span, _span_to_data),
    Prior: _Form(_read_prior, lambda one, _: [one.mean, one.std]),
    Penalty: _Form(_read_penalty, lambda one, _: [one.parameter, one.over]),
    Statistic: _Form(_read_statistic, lambda one, _: [one.kind, one.signal]),
    Prediction: _Form(_read_prediction, lambda one, _: [one.signal, one.ahead]),
    Origin: _Form(_read_origin, _origin_to_data, has_own_keys=True),
    Op: _Form(_read_op, lambda op, shared: {"op": type(op).__name__, **to_data(op, shared)}, True),
    Graph: _Form(
        _read_graph, lambda graph, shared: [to_data(node, shared) for node in graph.nodes]
    ),
    Type: _Form(lambda record, _, shared: _read_fields(Type, record, shared), to_data, True),
}
