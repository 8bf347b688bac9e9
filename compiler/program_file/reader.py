"""Makes a Program from the plain data of its file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Literal, TypeVar, get_args

from compiler.ir.fit import Fit
from compiler.ir.ops import Op, ReadTraining, Relation
from compiler.ir.program import (
    Declared,
    Dimension,
    Expected,
    Graph,
    History,
    InvalidPolicy,
    Loss,
    Measure,
    Memory,
    Node,
    Origin,
    Output,
    Parameter,
    Prediction,
    Program,
    RangePolicy,
    Role,
    Signal,
    State,
    Statistic,
    Tape,
)
from compiler.ir.types import Axis, Kind, Type
from compiler.program_file.plain_data import (
    Malformed,
    Record,
    as_integer,
    as_list,
    as_number,
    as_pair,
    as_text,
)
from compiler.program_file.unit_data import unit_from_data
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit

Choice = TypeVar("Choice")

_OPS: dict[str, type[Op]] = {op.__name__: op for op in get_args(Op) if op is not ReadTraining}
_KINDS: dict[str, Kind] = {"real": "real", "bool": "bool"}
_STATISTICS: dict[str, Literal["mean", "std"]] = {"mean": "mean", "std": "std"}
_FITTED: dict[str, Literal["iir", "state_space"]] = {"iir": "iir", "state_space": "state_space"}
_MEMORIES = {"of the run": True, "of the past": False}
_POLICIES: dict[str, InvalidPolicy] = {
    "clamp": "clamp",
    "hold": "hold",
    "flag": "flag",
    "trust": "trust",
}
_RANGE_POLICIES: dict[str, RangePolicy] = {
    "flag": "flag",
    "saturate": "saturate",
    "reset": "reset",
}
_FIELDS: dict[str, Callable[[Any, str], Any]] = {
    "str": as_text,
    "int": as_integer,
    "float": as_number,
    "tuple[float, ...]": lambda value, place: tuple(
        as_number(item, place) for item in as_list(value, place)
    ),
    "Relation": lambda value, place: _chosen(value, place, {r.value: r for r in Relation}),
}
"""How a field of an op is read, by the type that its declaration states."""


def read_program(data: Any) -> Program:
    """The program in the data, not verified yet. Raises Malformed."""
    record = Record(data, "the file")
    record.integer("format")
    reader = _Reader(record.items("files", as_text))
    program = Program(
        name=record.text("name"),
        sample_time=record.number("sample_time") if record.has("sample_time") else None,
        signals=record.items("signals", reader.signal),
        parameters=record.items("parameters", reader.parameter),
        states=record.items("states", reader.state),
        step=Graph(record.items("step", reader.node)),
        start=Graph(record.items("start", reader.node)),
        outputs=record.items("outputs", reader.output),
        losses=record.items("losses", reader.loss),
        expected=record.items("expected", reader.expected) if record.has("expected") else (),
        fits=record.items("fits", _fit) if record.has("fits") else (),
        dimensions=record.items("dimensions", _dimension),
        doc=record.text("doc"),
        spec_hash=record.text("spec_hash"),
    )
    record.close()
    return program


class _Reader:
    """Reads declarations and nodes; remembers the units and axes that occur again and again."""

    def __init__(self, files: tuple[str, ...]) -> None:
        self._files = files
        self._units: dict[str, Unit] = {}

    def signal(self, data: Any, place: str) -> Signal:
        record = Record(data, place)
        signal = Signal(
            name=record.text("name"),
            role=_chosen(record.text("role"), place, {role.value: role for role in Role}),
            axes=self._axes(record),
            unit=self._unit(record),
            range=_range(record),
            on_invalid=_chosen(record.text("on_invalid"), place, _POLICIES)
            if record.has("on_invalid")
            else "flag",
            doc=_doc(record),
            span=self._span(record),
        )
        record.close()
        return signal

    def parameter(self, data: Any, place: str) -> Parameter:
        record = Record(data, place)
        statistic: Statistic | None = None
        if record.has("statistic"):
            kind, signal = as_pair(record.raw("statistic"), place)
            statistic = Statistic(_chosen(kind, place, _STATISTICS), as_text(signal, place))
        parameter = Parameter(
            name=record.text("name"),
            axes=self._axes(record),
            unit=self._unit(record),
            initial=record.items("initial", as_number),
            minimum=record.number("minimum") if record.has("minimum") else None,
            maximum=record.number("maximum") if record.has("maximum") else None,
            scale=record.number("scale") if record.has("scale") else 1.0,
            learn=record.truth("learn") if record.has("learn") else True,
            statistic=statistic,
            doc=_doc(record),
            span=self._span(record),
        )
        record.close()
        return parameter

    def state(self, data: Any, place: str) -> State:
        record = Record(data, place)
        state = State(
            name=record.text("name"),
            axes=self._axes(record),
            unit=self._unit(record),
            origin=_origin(record),
            next=record.integer("next"),
            start=record.integer("start"),
            range=_range(record),
            doc=_doc(record),
            span=self._span(record),
            needs=_needs(record),
            on_range=_chosen(record.text("on_range"), place, _RANGE_POLICIES)
            if record.has("on_range")
            else "flag",
        )
        record.close()
        return state

    def output(self, data: Any, place: str) -> Output:
        record = Record(data, place)
        predicts: Prediction | None = None
        if record.has("predicts"):
            predicts = _prediction(record, "predicts")
        output = Output(
            name=record.text("name"),
            node=record.integer("node"),
            predicts=predicts,
            doc=_doc(record),
            span=self._span(record),
            needs=_needs(record),
        )
        record.close()
        return output

    def loss(self, data: Any, place: str) -> Loss:
        record = Record(data, place)
        loss = Loss(
            name=record.text("name"),
            measure=_chosen(record.text("measure"), place, {m.value: m for m in Measure}),
            prediction=record.integer("prediction"),
            target=record.integer("target") if record.has("target") else None,
            weight=record.number("weight"),
            share=record.number("share") if record.has("share") else 1.0,
            span=self._span(record),
        )
        record.close()
        return loss

    def expected(self, data: Any, place: str) -> Expected:
        record = Record(data, place)
        entry = Expected(
            record.text("name"),
            record.integer("node"),
            _bounds(record),
            self._span(record),
        )
        record.close()
        return entry

    def node(self, data: Any, place: str) -> Node:
        record = Record(data, place)
        make = _chosen(record.text("op"), place, _OPS)
        fields = {
            field.name: _FIELDS[str(field.type)](record.raw(field.name), f"{place}.{field.name}")
            for field in dataclasses.fields(make)
        }
        kind = _chosen(record.text("kind"), place, _KINDS) if record.has("kind") else "real"
        node = Node(
            op=make(**fields),
            args=record.items("args", as_integer) if record.has("args") else (),
            type=Type(self._axes(record), self._unit(record), kind),
            span=self._span(record),
            label=record.text("label") if record.has("label") else None,
        )
        record.close()
        return node

    def _axes(self, record: Record) -> tuple[Axis, ...]:
        return record.items("axes", _axis) if record.has("axes") else ()

    def _unit(self, record: Record) -> Unit | None:
        if not record.has("unit"):
            return None
        data, place = record.raw("unit"), f"{record.place}.unit"
        if not isinstance(data, str):
            return unit_from_data(data, place)
        if data not in self._units:
            self._units[data] = unit_from_data(data, place)
        return self._units[data]

    def _span(self, record: Record) -> Span | None:
        if not record.has("at"):
            return None
        numbers = record.items("at", as_integer)
        if len(numbers) != 5 or not 0 <= numbers[0] < len(self._files):
            raise Malformed(f"{record.place}.at is no place in a file")
        return Span(self._files[numbers[0]], *numbers[1:])


def _axis(data: Any, place: str) -> Axis:
    name, size = as_pair(data, place)
    return Axis(as_text(name, place), as_integer(size, place))


def _dimension(data: Any, place: str) -> Dimension:
    record = Record(data, place)
    dimension = Dimension(
        record.text("name"), record.integer("size"), record.items("labels", as_text)
    )
    record.close()
    return dimension


def _fit(data: Any, place: str) -> Fit:
    record = Record(data, place)
    target = _prediction(record, "target")
    fit = Fit(
        kind=_chosen(record.text("kind"), place, _FITTED),
        layer=record.text("layer"),
        input=record.text("input"),
        target=target.signal,
        ahead=target.ahead,
        num=record.integer("num"),
        den=record.integer("den"),
        feedthrough=record.truth("feedthrough"),
        radius=record.number("radius"),
    )
    record.close()
    return fit


def _prediction(record: Record, key: str) -> Prediction:
    signal, ahead = as_pair(record.raw(key), record.place)
    return Prediction(as_text(signal, record.place), as_integer(ahead, record.place))


def _origin(record: Record) -> Origin:
    if record.has("memory"):
        return Memory(_chosen(record.text("memory"), record.place, _MEMORIES))
    if record.has("history"):
        return History(record.text("history"))
    if record.has("tape"):
        signal, ahead = as_pair(record.raw("tape"), record.place)
        return Tape(as_text(signal, record.place), as_integer(ahead, record.place))
    return Declared()


def _range(record: Record) -> tuple[float, float] | None:
    return _bounds(record) if record.has("range") else None


def _bounds(record: Record) -> tuple[float, float]:
    low, high = as_pair(record.raw("range"), record.place)
    return (
        -math.inf if low is None else as_number(low, record.place),
        math.inf if high is None else as_number(high, record.place),
    )


def _needs(record: Record) -> tuple[str, ...]:
    return record.items("needs", as_text) if record.has("needs") else ()


def _doc(record: Record) -> str:
    return record.text("doc") if record.has("doc") else ""


def _chosen(value: Any, place: str, table: dict[str, Choice]) -> Choice:
    text = as_text(value, place)
    if text not in table:
        raise Malformed(f"{place}: {text[:40]!r} is none of {', '.join(table)}")
    return table[text]
