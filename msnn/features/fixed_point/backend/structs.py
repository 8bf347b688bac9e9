"""Lays out the structs of the fixed-point header and describes ports: scale, limits, macros."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from backends.c.interface.structs import READY, outputs_text
from backends.c_language.layout import comment
from backends.c_lowering.spec_notes import span_text
from compiler.ir.types import Axis
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.integers.program import IntegerMemory, IntegerProgram, WordPort


def structs(program: IntegerProgram, names: FixedNames) -> list[dict[str, Any]]:
    """All struct types; each field has its declaration and its description."""
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
    """Unit, limits, scale, description and spec position of a port."""
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
