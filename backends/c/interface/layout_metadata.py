"""Describes generated C as JSON data: ports, fields of every struct, and the Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias, assert_never

from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.jacobian_interface import JacobianInterface
from backends.c.interface.status import MEANING, SelfTestBit, status_macro
from backends.c.interface.structs import StructField, structs
from backends.c_lowering.state_memory import (
    DelayLine,
    DoubledRing,
    PlainState,
    ShiftBuffer,
    StateMemory,
)
from backends.files.export_identity import OPEN
from backends.ports.metadata import interface_metadata, json_range
from backends.ports.step_interface import PortNames, step_interface
from compiler.ir.program import Declared, History, LayerMemory, Program, Tape
from compiler.jacobian.matrices import Matrix, Vector


def layout_metadata(
    program: Program, interface: Interface, weights: Mapping[str, NDArray[Any]]
) -> dict[str, Any]:
    """The content of `<prefix>.json` as data for `json.dumps`: ports, parameters and states as in
    every export, and in the entry `c` the structs, status bits and Jacobian of the C code.
    `weights` are physical arrays by name.
    """
    ports = step_interface(program)
    states = {memory.state.name: memory.identifier for memory in interface.states}
    windows = {field.name: field.identifier for field, _ in interface.windows}
    names = PortNames(
        inputs={input.field.name: input.field.identifier for input in interface.inputs},
        states=states,
        parameters={field.name: field.identifier for field in interface.parameters},
        outputs={field.name: field.identifier for field in interface.outputs},
        # C updates states in place: the next state has the same field
        next_states=states,
        start_windows={port.signal.name: "" for port in ports.start_windows} | windows,
    )
    data = interface_metadata(program, ports, names, weights)
    # the C interface has no port for windows that only a caller-supplied state would need
    data["start_windows"] = [port for port in data["start_windows"] if port["port"]]
    ranges = _ranges(program, interface)
    data["export_sha256"] = OPEN
    data["c"] = {
        "prefix": interface.prefix,
        "dtype": interface.options.dtype,
        "exact": interface.options.is_exact,
        "takes_parameters": interface.takes_parameters,
        "status": {
            status_macro(interface.prefix, bit): int(bit)
            # all bits, even those that this model cannot return: readers need only one table
            for bit in MEANING
            if interface.calibrates or bit is not SelfTestBit.CHECKSUM_DIFFERS
        },
        "on_invalid": {
            input.field.identifier: input.port.signal.on_invalid for input in interface.inputs
        },
        "structs": {
            struct.name: [_field(field, struct.name, ranges) for field in struct.fields]
            for struct in structs(interface)
        },
        "states": [_state(memory) for memory in interface.states],
    }
    if interface.calibrates:
        data["c"]["calibration"] = {
            "variable": f"{interface.prefix}_calibration",
            "section": interface.calibration_section,
            "checksum": "CRC-32 of the numbers in their order, least significant bytes first",
        }
    if interface.jacobian is not None:
        data["c"]["jacobian"] = jacobian_metadata(interface.jacobian)
    return data


def _state(memory: StateMemory) -> dict[str, Any]:
    """The JSON description of the storage of a state: its field, shape, and `kind` (`plain`;
    `shift` for a shifted buffer; `ring` for a ring buffer, with the field of its write position).
    """
    value: dict[str, Any] = {
        "name": memory.state.name,
        "field": memory.identifier,
        "shape": [*memory.shape],
    }
    match memory:
        # a delay line has the layout of the state: oldest sample first, no spare element
        case PlainState() | DelayLine():
            return {**value, "kind": "plain"}
        case ShiftBuffer():
            return {**value, "kind": "shift"}
        case DoubledRing():
            return {**value, "kind": "ring", "head": memory.head}


def _field(field: StructField, struct: str, ranges: _Ranges) -> dict[str, Any]:
    return {
        "name": field.name,
        "field": field.identifier,
        "type": "uint32" if field.unsigned else "real",
        "shape": [*field.shape],
        "range": json_range(ranges.get((struct, field.identifier))),
    }


_Ranges: TypeAlias = dict[tuple[str, str], tuple[float, float] | None]
"""(lower, upper) by name of struct and identifier of field; None if the field has no range."""


def _ranges(program: Program, interface: Interface) -> _Ranges:
    """The ranges of inputs, held inputs and states in the spec. A buffer without a range has that
    of the signal that it stores.
    """
    declared = {signal.name: signal.range for signal in program.signals}
    ranges: _Ranges = {}
    for input in interface.inputs:
        limits = input.port.signal.range
        ranges["in", input.field.identifier] = limits
        if input.held is not None:
            # the held value was valid
            ranges["state", input.held] = limits
    for memory in interface.states:
        state = memory.state
        match state.origin:
            case Declared() | LayerMemory():
                kept = state.range
            case History(source):
                kept = state.range or declared.get(source)
            case Tape(signal):
                kept = state.range or declared.get(signal)
            case _:
                assert_never(state.origin)
        ranges["state", memory.identifier] = kept
    return ranges


def jacobian_metadata(interface: JacobianInterface) -> dict[str, Any]:
    """The Jacobian as JSON data: the quantities of each vector by letter, and for each matrix the
    (row, column) of its constant, parameter-dependent and computed entries. Entries that are not
    listed are always 0.
    """
    found = interface.jacobian
    vectors = (found.states, found.inputs, found.outputs, found.parameters)
    return {
        "vectors": {vector.letter: _members(vector) for vector in vectors},
        "matrices": {field.matrix.name: _matrix(field.matrix) for field in interface.fields},
    }


def _members(vector: Vector) -> list[dict[str, Any]]:
    return [
        {
            "name": member.name,
            "first": member.first,
            "shape": [axis.size for axis in member.axes],
            "unit": member.unit and member.unit.text,
        }
        for member in vector.members
    ]


def _matrix(matrix: Matrix) -> dict[str, Any]:
    columns = matrix.columns.size
    places = [divmod(entry, columns) for entry in range(matrix.size)]
    entries = list(zip(places, matrix.known, matrix.fixed, strict=True))
    return {
        "rows": matrix.rows.letter,
        "columns": matrix.columns.letter,
        "constant": [[*place, known] for place, known, _ in entries if known],
        "of_parameters": [[*place] for place, known, fixed in entries if known is None and fixed],
        "computed": [[*place] for place, known, fixed in entries if known is None and not fixed],
    }
