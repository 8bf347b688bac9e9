"""Lays out the structs in fixed point: names, types, ports, and variables to calibrate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from backends.asap2.objects import CalibratedModel, MemoryObject, Scale, Storage, Struct
from backends.c.interface.structs import READY, outputs_text
from backends.c_language.printer import Printer
from backends.c_language.rendering import comment
from backends.c_lowering.spec_notes import span_text
from backends.ports.identifiers import c_identifier
from compiler.ir.types import WINDOW, Axis
from msnn.features.fixed_point.integers.interpret import FixedStatus
from msnn.features.fixed_point.integers.program import IntegerMemory, IntegerProgram, WordPort


def structs(program: IntegerProgram, names: FixedNames) -> list[dict[str, Any]]:
    """The structs `in`, `out`, `init` and `state` for templates and the JSON description; each
    field has its C declaration and its facts.
    """
    word = f"{names.prefix}_word_t"
    state = [
        _field(m, names.memories[m.name], f"{names.prefix}_sum_t" if m.wide else word)
        for m in program.memories
    ]
    for entry in program.inputs:
        if entry.port.name in names.held:
            held = _field(entry.port, names.held[entry.port.name], word)
            state.append({**held, "comment": comment("last valid value", "    ")})
    state.append(_unsigned(names.ready, READY))
    inputs = [_field(e.port, names.inputs[e.port.name], word) for e in program.inputs]
    outputs = [_field(port, names.outputs[port.name], word) for port, _ in program.outputs]
    starts = [_field(port, names.windows[port.name], word) for port in program.windows]
    return [
        # the order of the four is that of the functions' arguments; the JSON file keeps it
        _struct("in", "Inputs of a step.", inputs),
        _struct("out", outputs_text(program.late), outputs),
        _struct("init", "What reset takes: samples around the first step t0.", starts),
        _struct("state", "The memory of one instance: plain data.", state),
    ]


def _port_comment(port: WordPort | IntegerMemory) -> str:
    """Unit, limits, scale, doc and place in the spec of a port, as text of a C comment."""
    unit = f"[{port.unit.text}] " if port.unit is not None else ""
    # exact: a word of 32 bits times a power of two is a double
    low, high = (math.ldexp(limit, -port.fraction) for limit in (port.low, port.high))
    doc = f"; {port.doc.strip()}" if port.doc.strip() else ""
    place = f" ({span_text(port.span)})" if port.span is not None else ""
    return f"{unit}{low:.6g} .. {high:.6g}, word / 2^{port.fraction}{doc}{place}"


def _field(port: WordPort | IntegerMemory, field: str, type: str) -> dict[str, Any]:
    size = f"[{port.size}]" if port.axes else ""
    low, high = (math.ldexp(limit, -port.fraction) for limit in (port.low, port.high))
    return {
        "declaration": f"{type} {field}{size};",
        "comment": comment(f"{_port_comment(port)}{_order(port.axes)}", "    "),
        "about": {
            "name": port.name,
            "field": field,
            "type": "sum" if type.endswith("_sum_t") else "word",
            "shape": [axis.size for axis in port.axes],
            "range": [low, high],
            "fraction": port.fraction,
        },
    }


def _order(axes: Sequence[Axis]) -> str:
    if len(axes) < 2:
        return ""
    return "; " + " x ".join(f"{axis.name or 'element'} {axis.size}" for axis in axes)


def _unsigned(field: str, text: str) -> dict[str, Any]:
    about: dict[str, Any] = {
        "name": None,
        "field": field,
        "type": "uint32",
        "shape": [],
        "range": None,
    }
    return {
        "declaration": f"uint32_t {field};",
        "comment": comment(text, "    "),
        "about": about,
    }


def _struct(name: str, text: str, fields: list[dict[str, Any]]) -> dict[str, Any]:
    listed = fields or [_unsigned("reserved", "C allows no empty struct")]
    return {"name": name, "comment": comment(text), "fields": listed}


def port_facts(program: IntegerProgram, names: FixedNames) -> list[dict[str, Any]]:
    """The properties that templates show of each input, output and sample around the start."""
    listed = [
        *(("input", e.port, names.inputs[e.port.name]) for e in program.inputs),
        *(("output", port, names.outputs[port.name]) for port, _ in program.outputs),
        *(("start", port, names.windows[port.name]) for port in program.windows),
    ]
    return [_facts(kind, port, field, names, program) for kind, port, field in listed]


def _facts(
    kind: str, port: WordPort, field: str, names: FixedNames, program: IntegerProgram
) -> dict[str, Any]:
    infix = "x0_" if kind == "start" else ""
    macro = f"{names.macro}_{infix.upper()}{field.upper()}"
    ending = "F" if program.width.word == 16 else ""
    step = math.ldexp(1.0, -port.fraction)
    return {
        "kind": kind,
        "name": port.name,
        "macro": macro,
        "function": f"{names.prefix}_{infix}{field}",
        "goes_in": kind != "output",
        "comment": comment(f"{kind} {port.name}: {_port_comment(port)}"),
        "fraction": port.fraction,
        "low": port.low,
        "high": port.high,
        "step": f"{step:.3g}",
        "scale": f"{math.ldexp(1.0, port.fraction)!r}{ending}",
        "unscale": f"{step!r}{ending}",
    }


def real_type(program: IntegerProgram) -> dict[str, str]:
    """The floating-point type that represents every word exactly, and constants of this type."""
    if program.width.word == 16:
        return {"real": "float", "zero": "0.0F", "half": "0.5F"}
    return {"real": "double", "zero": "0.0", "half": "0.5"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedNames:
    """C identifiers by the names of the spec; each dict belongs to one struct (`memories` and
    `held` share the state struct).
    """

    model: str
    """Name of the program."""
    prefix: str
    inputs: dict[str, str]
    outputs: dict[str, str]
    windows: dict[str, str]
    memories: dict[str, str]
    held: dict[str, str]
    ready: str

    @property
    def macro(self) -> str:
        return self.prefix.upper()

    @property
    def takes_parameters(self) -> bool:
        """Always False: weights are constants in the code."""
        return False

    def status(self, bit: FixedStatus) -> str:
        """The macro of a status bit."""
        assert bit.name is not None
        return f"{self.macro}_STATUS_{bit.name}"


def fixed_names(program: IntegerProgram, prefix: str) -> FixedNames:
    """The C names of a program: they differ from words of C, within a struct also from each other.
    `prefix` gets a number if it is a word of C.
    """
    prefix = c_identifier(prefix, set())
    # one set a struct: members of different structs may share a name in C
    ins, outs, wins, mems = (set[str]() for _ in range(4))
    # before the memories: a state that is called so gives way
    ready = c_identifier("ready", mems)
    return FixedNames(
        model=program.name,
        prefix=prefix,
        inputs={e.port.name: c_identifier(e.port.name, ins) for e in program.inputs},
        outputs={port.name: c_identifier(port.name, outs) for port, _ in program.outputs},
        windows={port.name: c_identifier(port.name, wins) for port in program.windows},
        memories={memory.name: c_identifier(memory.name, mems) for memory in program.memories},
        # held words lie in the state struct, among the memories, and so take names from their set
        held={
            e.port.name: c_identifier(f"{e.port.name}.held", mems)
            for e in program.inputs
            if e.policy == "hold"
        },
        ready=ready,
    )


def fixed_printer(program: IntegerProgram, names: FixedNames) -> Printer:
    """Prints C with the program's types."""
    sum_bits = 64 if program.width.sum == 64 else 32
    return Printer(names.prefix, sum_bits=sum_bits, places_tables=True)


_STORAGES: dict[int, Storage] = {16: "SWORD", 32: "SLONG", 64: "A_INT64"}


def calibrated_model(program: IntegerProgram, names: FixedNames) -> CalibratedModel:
    """The inputs, outputs and states for an ASAP2 file, with the scales from words to physical
    units.

    Weights are constants in the code, and buffers are omitted.
    """
    return CalibratedModel(
        name=program.name,
        prefix=names.prefix,
        doc=program.doc,
        version=program.spec_hash,
        objects=tuple(_objects(program, names)),
        remark="Parameters are numbers in the code.",
    )


def _objects(program: IntegerProgram, names: FixedNames) -> Iterable[MemoryObject]:
    word, wide = program.width.word, program.width.sum
    for entry in program.inputs:
        yield _object(entry.port, "in", names.inputs[entry.port.name], word)
    for port, _ in program.outputs:
        yield _object(port, "out", names.outputs[port.name], word)
    for memory in program.memories:
        # buffers move every step: at a fixed address a tool would see another sample each time
        if all(axis.name != WINDOW for axis in memory.axes):
            bits = wide if memory.wide else word
            yield _object(memory, "state", names.memories[memory.name], bits)


def _object(port: WordPort | IntegerMemory, struct: Struct, member: str, bits: int) -> MemoryObject:
    # a power of two: physical limits below are exact
    factor = math.ldexp(1.0, -port.fraction)
    return MemoryObject(
        name=port.name,
        member=member,
        struct=struct,
        doc=port.doc,
        axes=tuple((axis.name, axis.size) for axis in port.axes),
        scale=Scale("" if port.unit is None else port.unit.text, factor),
        low=port.low * factor,
        high=port.high * factor,
        storage=_STORAGES[bits],
    )
