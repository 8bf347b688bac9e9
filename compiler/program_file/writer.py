"""Turns a Program into plain data for its file."""

from __future__ import annotations

import dataclasses
import math
from enum import Enum
from pathlib import PurePath
from typing import Any, assert_never

from compiler.ir.fit import Fit
from compiler.ir.program import (
    Declared,
    Expected,
    Graph,
    History,
    Loss,
    Memory,
    Node,
    Origin,
    Output,
    Parameter,
    Program,
    Signal,
    State,
    Tape,
)
from compiler.ir.types import Type
from compiler.program_file.unit_data import unit_to_data
from spec_schema.diagnostics.source import Span

FORMAT = 1
"""Version of the file; readers refuse another one."""

Data = dict[str, Any]


def program_to_data(program: Program) -> Data:
    """Dictionaries, lists, strings and numbers from which `program_from_data` makes it again.

    Numbers keep every bit, units are written by their text, places by the name of their file
    without its folder. What has its default value is left out.
    """
    files = _files(program)
    data: Data = {
        "format": FORMAT,
        "name": program.name,
        "doc": program.doc,
        "spec_hash": program.spec_hash,
        "sample_time": program.sample_time,
        "files": list(files),
        "dimensions": [
            {"name": d.name, "size": d.size, "labels": list(d.labels)} for d in program.dimensions
        ],
        "signals": [_signal(signal, files) for signal in program.signals],
        "parameters": [_parameter(parameter, files) for parameter in program.parameters],
        "states": [_state(state, files) for state in program.states],
        "start": _graph(program.start, files),
        "step": _graph(program.step, files),
        "outputs": [_output(output, files) for output in program.outputs],
        "losses": [_loss(loss, files) for loss in program.losses],
    }
    if program.expected:
        data["expected"] = [_expected(entry, files) for entry in program.expected]
    if program.fits:
        data["fits"] = [_fit(fit) for fit in program.fits]
    return data


_Files = dict[str, int]


def _files(program: Program) -> _Files:
    spans = [node.span for graph in (program.start, program.step) for node in graph.nodes]
    for declared in (program.signals, program.parameters, program.states):
        spans += [item.span for item in declared]
    for declared in (program.outputs, program.losses, program.expected):
        spans += [item.span for item in declared]
    names = dict.fromkeys(PurePath(span.file).name for span in spans if span is not None)
    return {name: index for index, name in enumerate(names)}


def _signal(signal: Signal, files: _Files) -> Data:
    data: Data = {"name": signal.name, "role": signal.role.value, **_value(signal)}
    if signal.range is not None:
        data["range"] = _range(signal.range)
    if signal.on_invalid != "flag":
        data["on_invalid"] = signal.on_invalid
    return data | _place(signal.doc, signal.span, files)


def _parameter(parameter: Parameter, files: _Files) -> Data:
    data: Data = {"name": parameter.name, **_value(parameter), "initial": list(parameter.initial)}
    if parameter.minimum is not None:
        data["minimum"] = parameter.minimum
    if parameter.maximum is not None:
        data["maximum"] = parameter.maximum
    if parameter.scale != 1.0:
        data["scale"] = parameter.scale
    if not parameter.learn:
        data["learn"] = False
    if parameter.statistic is not None:
        data["statistic"] = [parameter.statistic.kind, parameter.statistic.signal]
    return data | _place(parameter.doc, parameter.span, files)


def _state(state: State, files: _Files) -> Data:
    data: Data = {
        "name": state.name,
        **_value(state),
        **_origin(state.origin),
        "next": state.next,
        "start": state.start,
    }
    if state.range is not None:
        data["range"] = _range(state.range)
    if state.on_range != "flag":
        data["on_range"] = state.on_range
    if state.needs:
        data["needs"] = list(state.needs)
    return data | _place(state.doc, state.span, files)


def _origin(origin: Origin) -> Data:
    match origin:
        case Declared():
            return {}
        case Memory(of_run):
            return {"memory": "of the run" if of_run else "of the past"}
        case History(source):
            return {"history": source}
        case Tape(signal, ahead):
            return {"tape": [signal, ahead]}
        case _:
            assert_never(origin)


def _output(output: Output, files: _Files) -> Data:
    data: Data = {"name": output.name, "node": output.node}
    if output.predicts is not None:
        data["predicts"] = [output.predicts.signal, output.predicts.ahead]
    if output.needs:
        data["needs"] = list(output.needs)
    return data | _place(output.doc, output.span, files)


def _loss(loss: Loss, files: _Files) -> Data:
    data: Data = {
        "name": loss.name,
        "measure": loss.measure.value,
        "prediction": loss.prediction,
        "target": loss.target,
        "weight": loss.weight,
    }
    if loss.share != 1.0:
        data["share"] = loss.share
    return data | _place("", loss.span, files)


def _expected(entry: Expected, files: _Files) -> Data:
    data: Data = {"name": entry.name, "node": entry.node, "range": _range(entry.range)}
    return data | _place("", entry.span, files)


def _fit(fit: Fit) -> Data:
    return {
        "kind": fit.kind,
        "layer": fit.layer,
        "input": fit.input,
        "target": [fit.target, fit.ahead],
        "num": fit.num,
        "den": fit.den,
        "feedthrough": fit.feedthrough,
        "radius": fit.radius,
    }


def _graph(graph: Graph, files: _Files) -> list[Data]:
    return [_node(node, files) for node in graph.nodes]


def _node(node: Node, files: _Files) -> Data:
    data: Data = {"op": type(node.op).__name__}
    for field in dataclasses.fields(node.op):
        data[field.name] = _plain(getattr(node.op, field.name))
    if node.args:
        data["args"] = list(node.args)
    data |= _value(node.type)
    if node.type.kind != "real":
        data["kind"] = node.type.kind
    if node.label is not None:
        data["label"] = node.label
    return data | _place("", node.span, files)


def _plain(value: str | float | tuple[float, ...] | Enum) -> Any:
    match value:
        case Enum():
            return value.value
        case tuple():
            return list(value)
        case _:
            return value


def _value(item: Signal | Parameter | State | Type) -> Data:
    data: Data = {}
    if item.axes:
        data["axes"] = [[axis.name, axis.size] for axis in item.axes]
    if item.unit is not None:
        data["unit"] = unit_to_data(item.unit)
    return data


def _range(bounds: tuple[float, float]) -> list[float | None]:
    """An infinite bound is null."""
    return [bound if math.isfinite(bound) else None for bound in bounds]


def _place(doc: str, span: Span | None, files: _Files) -> Data:
    data: Data = {"doc": doc} if doc else {}
    if span is not None:
        file = files[PurePath(span.file).name]
        data["at"] = [file, span.line, span.column, span.end_line, span.end_column]
    return data
