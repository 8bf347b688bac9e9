"""Reads and writes the parts of a program as JSON, according to the declared types of their fields.

Each field of a class is one key. Default values are omitted, as are empty axes and units.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field
from enum import Enum, EnumType
from fractions import Fraction
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
    Penalty,
    Prior,
    Statistic,
    Tape,
)
from compiler.ir.types import Axis, Prediction, Type
from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE, Unit, UnitError, unit_symbol

Read = TypeVar("Read")

# a double represents every integer up to this limit
_LARGEST_INTEGER = 1 << 53
_LONGEST_STRING = 1 << 20


class Malformed(Exception):  # noqa: N818  (carried to the reader's edge, where it becomes a Diagnostic)
    """Raised for a value that is missing or of the wrong kind; the text says which one. Readers of
    whole files turn it into a diagnostic.
    """


class PlainRecord:
    """Reads a JSON object and checks that all its keys are read; `place` is its path in the file.
    The methods that return a value raise Malformed if the key is missing or its value of the wrong
    kind.
    """

    def __init__(self, data: Any, place: str) -> None:
        if not isinstance(data, dict):
            raise Malformed(f"{place} is no object")
        self._data = cast("dict[str, Any]", data)
        self._read = set[str]()
        self.place = place

    def close(self) -> None:
        """Raises Malformed if the object has a key that no method has read."""
        for key in self._data:
            if key not in self._read:
                raise Malformed(f"{self.place} has the unknown key {key[:40]!r}")

    def has(self, key: str) -> bool:
        """True if the key exists with a value other than null; the key counts as read."""
        self._read.add(key)
        return self._data.get(key) is not None

    def raw(self, key: str) -> Any:
        self._read.add(key)
        if key not in self._data:
            raise Malformed(f"{self.place} has no {key!r}")
        return self._data[key]

    def _place(self, key: str) -> str:
        return f"{self.place}.{key}"

    def text(self, key: str) -> str:
        return as_text(self.raw(key), self._place(key))

    def integer(self, key: str) -> int:
        return as_integer(self.raw(key), self._place(key))

    def number(self, key: str) -> float:
        return as_number(self.raw(key), self._place(key))

    def truth(self, key: str) -> bool:
        value = self.raw(key)
        if not isinstance(value, bool):
            raise Malformed(f"{self._place(key)} is neither true nor false")
        return value

    def items(self, key: str, read: Callable[[Any, str], Read]) -> tuple[Read, ...]:
        """The list under the key; `read(item, place)` reads each item and receives its path in the
        file. Raises Malformed if there is no list.
        """
        place = self._place(key)
        return tuple(
            read(item, f"{place}[{index}]")
            for index, item in enumerate(as_list(self.raw(key), place))
        )


def as_list(value: Any, place: str) -> list[Any]:
    if not isinstance(value, list):
        raise Malformed(f"{place} is no list")
    return cast("list[Any]", value)


def as_text(value: Any, place: str) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST_STRING:
        raise Malformed(f"{place} is no text")
    return value


def as_integer(value: Any, place: str) -> int:
    # in Python a bool is an `int`
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > _LARGEST_INTEGER:
        raise Malformed(f"{place} is no whole number")
    return value


def as_number(value: Any, place: str) -> float:
    if isinstance(value, int):
        return float(as_integer(value, place))
    if not isinstance(value, float) or not math.isfinite(value):
        raise Malformed(f"{place} is no finite number")
    return value


def as_pair(value: Any, place: str) -> tuple[Any, Any]:
    pair = as_list(value, place)
    if len(pair) != 2:
        raise Malformed(f"{place} is no pair")
    return pair[0], pair[1]


_MOST_FACTORS = 100
_LARGEST_POWER = 1000


def unit_to_data(unit: Unit) -> Any:
    """The unit as its text, such as `"N*m"`. Units that the text cannot express, such as the root
    of a metre, become factors with powers: `[["m", "1/2"]]`.
    """
    try:
        # roots of units have a text that nothing reads, and products may round their scale another
        # way
        readable = parse_unit(unit.text).same_as(unit)
    except UnitError:
        readable = False
    return unit.text if readable else [[symbol, str(power)] for symbol, power in unit.factors]


def unit_from_data(data: Any, place: str) -> Unit:
    """Reads a unit from `data` as `unit_to_data` writes it; `place` is its path in the file. Raises
    Malformed for any other data.
    """
    if isinstance(data, str):
        try:
            return parse_unit(data)
        except UnitError as error:
            raise Malformed(f"{place}: {error}") from error
    factors = as_list(data, place)
    if len(factors) > _MOST_FACTORS:
        raise Malformed(f"{place} has too many factors")
    unit = ONE
    for factor in factors:
        symbol, power = as_pair(factor, place)
        base = unit_symbol(as_text(symbol, place))
        if base is None:
            raise Malformed(f"{place} has an unknown symbol")
        unit = unit * base.power(_power(power, place))
    return unit


def _power(data: Any, place: str) -> Fraction:
    text = as_text(data, place)
    try:
        # the cap is on the text too, since a long number is slow to read
        power = Fraction(text) if len(text) < 20 else Fraction(_LARGEST_POWER + 1)
    except (ValueError, ZeroDivisionError) as error:
        raise Malformed(f"{place} has a power that is no fraction") from error
    if abs(power) > _LARGEST_POWER:
        raise Malformed(f"{place} has a power that is too large")
    return power


Data = dict[str, Any]
Made = TypeVar("Made")

_ALWAYS = {(Parameter, "initial"), (Loss, "weight"), (Dimension, "labels")}
"""Fields that are written even if they have their default value."""


@dataclass(frozen=True, slots=True)
class Shared:
    """Facts that all values of one file share: `files`, the paths of its specs, to which places in
    the spec refer by index; and `units`, those parsed before, by their text.
    """

    files: tuple[str, ...]
    numbers: Mapping[str, int] = field(default_factory=dict[str, int])
    """Index of each spec by path, for writing."""
    units: dict[str, Unit] = field(default_factory=dict[str, Unit])


def read(make: type[Made], data: Any, place: str, shared: Shared) -> Made:
    """Reads an object of the dataclass `make` from the JSON object `data`; `place` is its path in
    the file, `shared` has the facts that all values of the file share. Raises Malformed.
    """
    record = PlainRecord(data, place)
    made = _read_fields(make, record, shared)
    record.close()
    return made


def to_data(value: object, shared: Shared) -> Data:
    """A JSON object with the fields of a dataclass object, from which `read` restores it; `shared`
    has the facts that all values of the file share.
    """
    data: Data = {}
    for one in _fields(type(value)):
        found = getattr(value, one.name)
        if one.absent is MISSING or found != one.absent:
            written = one.form.write(found, shared)
            data |= written if one.form.has_own_keys else {one.key: written}
    return data


@dataclass(frozen=True, slots=True)
class _Form:
    """The functions that read and write the values of one type."""

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
    """The value with which the field is omitted from the file; MISSING if it is always written."""


@cache
def _fields(made: type) -> tuple[_Field, ...]:
    """The fields of the dataclass `made` in the order of the file: `doc` and `span` come last."""
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
    """The limits [low, high] of a range as JSON; an infinite limit becomes null."""
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
