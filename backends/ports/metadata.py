"""Describes the ports of an exported step as JSON data: names, axes, units, lags, values."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from backends.ports.step_interface import Port, PortNames, StepInterface
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import (
    Declared,
    History,
    LayerMemory,
    Origin,
    Output,
    Parameter,
    Program,
    State,
    Tape,
)
from compiler.ir.types import Axis
from spec_schema.units.unit import Unit

FORMAT = 1
"""Version of the data's layout; increased if older readers would misread it."""


def interface_metadata(
    program: Program,
    interface: StepInterface,
    names: PortNames,
    weights: Mapping[str, ArrayLike] | None = None,
) -> dict[str, Any]:
    """The description of an exported step as data for `json.dumps`: all ports with axes, units and
    ranges, and the values of parameters. `name` is a name in the spec, `port` its name in the
    export.

    Numbers are physical, in the given unit; `unit` is null if the spec has none. `weights` are
    physical arrays by name; a missing one, or None, means initial values. The outputs of a step
    that is `late` are those of `late` samples before t. All sample offsets, also of the start, are
    relative to the t at which the step is called. Raises ValueError for a weight of a wrong shape.
    """
    # physical values, as raw values are internal
    arrays = physical_weights(program, weights or {})
    # includes parameters that only the start needs
    parameters = {p.name: p for p in (*interface.parameters, *interface.start_parameters)}
    return {
        "format": FORMAT,
        "made_by": program.made_by,
        "model": program.name,
        "doc": program.doc,
        "spec_sha256": program.spec_hash,
        "sample_time": program.sample_time,
        **({"late": program.late} if program.late else {}),
        "inputs": [_port(p, names.inputs[p.signal.name]) for p in interface.inputs],
        "outputs": [_output(program, o, names.outputs[o.name]) for o in interface.outputs],
        "states": [_state(state, names) for state in interface.states],
        "parameters": [
            _parameter(p, names.parameters[p.name], arrays[p.name].ravel().tolist())
            for p in parameters.values()
        ],
        "start_windows": [
            _port(p, names.start_windows[p.signal.name]) for p in interface.start_windows
        ],
        "dimensions": [
            {"name": d.name, "size": d.size, "labels": list(d.labels)} for d in program.dimensions
        ],
    }


def metadata_text(metadata: Mapping[str, Any]) -> str:
    """The data as JSON text with a line end; the same data give the same text. Raises ValueError
    for NaN and infinities.
    """
    return json.dumps(metadata, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _port(port: Port, name: str) -> dict[str, Any]:
    signal = port.signal
    return {
        **_value(signal.name, name, port.type.axes, signal.unit, signal.doc),
        "first_sample": port.first,
        "last_sample": port.last,
        "lag": port.lag,
        "range": json_range(signal.range),
    }


def _output(program: Program, output: Output, name: str) -> dict[str, Any]:
    type = program.step[output.node].type
    predicts = output.predicts
    return {
        **_value(output.name, name, type.axes, type.unit, output.doc),
        "range": json_range(program.expected_range(output.name)),
        "predicts": predicts
        # relative to the t at which the step is called
        and {"signal": predicts.signal, "ahead": predicts.ahead - program.late},
    }


def _state(state: State, names: PortNames) -> dict[str, Any]:
    return {
        **_value(state.name, names.states[state.name], state.axes, state.unit, state.doc),
        "next_port": names.next_states[state.name],
        "origin": _origin(state.origin),
        "range": json_range(state.range),
    }


def _origin(origin: Origin) -> dict[str, Any]:
    match origin:
        # `kind` is read by tools in other languages, so it is independent of class names
        case Declared():
            return {"kind": "declared"}
        case LayerMemory():
            return {"kind": "memory"}
        case History(source):
            return {"kind": "history", "source": source}
        case Tape(signal, ahead):
            return {"kind": "tape", "signal": signal, "ahead": ahead}


def _parameter(parameter: Parameter, name: str, values: list[float]) -> dict[str, Any]:
    return {
        **_value(parameter.name, name, parameter.axes, parameter.unit, parameter.doc),
        # a parameter without bounds has an open range, two nulls
        "range": json_range(
            (_or_infinite(parameter.minimum, -1), _or_infinite(parameter.maximum, 1))
        ),
        "values": values,
    }


def _value(
    spec_name: str, port: str, axes: tuple[Axis, ...], unit: Unit | None, doc: str
) -> dict[str, Any]:
    return {
        "name": spec_name,
        "port": port,
        "axes": [{"name": axis.name, "size": axis.size} for axis in axes],
        "unit": unit and unit.text,
        "doc": doc,
    }


def _or_infinite(bound: float | None, sign: int) -> float:
    return sign * math.inf if bound is None else bound


def json_range(bounds: tuple[float, float] | None) -> list[float | None] | None:
    """(minimum, maximum) as a list for JSON, with None (null) for an infinite side; None for no
    range.
    """
    if bounds is None:
        return None
    return [bound if math.isfinite(bound) else None for bound in bounds]
