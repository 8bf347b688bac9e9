"""Says what the words of each port stand for: scale, limits and the names of its macros."""

from __future__ import annotations

import math
from typing import Any

from backends.c_language.layout import comment
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.backend.structs import port_comment
from msnn.features.fixed_point.integers.program import IntegerProgram, WordPort


def port_facts(program: IntegerProgram, names: FixedNames) -> list[dict[str, Any]]:
    """The facts that templates show of every input, output and sample around the start."""
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
        "comment": comment(f"{kind} {port.name}: {port_comment(port)}"),
        "fraction": port.fraction,
        "low": port.low,
        "high": port.high,
        "step": f"{step:.3g}",
        "scale": f"{math.ldexp(1.0, port.fraction)!r}{ending}",
        "unscale": f"{step!r}{ending}",
    }


def real_type(program: IntegerProgram) -> dict[str, str]:
    """The floating-point type that holds every word of a width, and numbers of it."""
    if program.width.word == 16:
        return {"real": "float", "zero": "0.0F", "half": "0.5F"}
    return {"real": "double", "zero": "0.0", "half": "0.5"}
