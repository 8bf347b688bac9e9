"""Writes the assumptions of a proof: drawn states and inputs, bounds of math functions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from msnn.verification.exported_c import ExportedC, Range, RangedField

ASSUMED = 1e6
"""Assumed magnitude of a value without a declared range; the report names each."""

REPLACED = ("clamp", "hold")
"""Policies that accept any float."""


def assumed_range(member: RangedField, model: ExportedC) -> Range:
    """The range of a state or an input, rounded like in the generated code."""
    low, high = member.range or (-ASSUMED, ASSUMED)
    number = np.float32 if model.dtype == "float32" else np.float64
    # a limit in float32 may lie outside the spec's: the code compares with this one
    return float(number(low)), float(number(high))


def drawn(struct: str, members: Iterable[RangedField], model: ExportedC) -> Iterator[str]:
    """Lines of C that give each member of a struct any value of its range, for the proof."""
    for member in members:
        if member.unsigned:
            # its interval is of int: all bit patterns, as an index may have any
            value = "(uint32_t)Frama_C_interval(-2147483647 - 1, 2147483647)"
        else:
            value = _between(*assumed_range(member, model), model)
        if member.size is None:
            yield f"{struct}.{member.field} = {value};"
        else:
            loop = f"for (uint32_t i = 0U; i < {member.size}U; i++)"
            yield f"{loop} {struct}.{member.field}[i] = {value};"


def outside_ranges(model: ExportedC, *, infinite: bool) -> list[str]:
    """Cases in which one input is outside its range, if a policy replaces it.

    One input at a time suffices, because each is replaced independently by an already drawn value.
    Either finite values or infinities; empty without such a policy. Separate cases are needed for
    Eva to relate the test of the input to the corrected copy.
    """
    values = _infinite if infinite else _beyond
    cases = [
        f"{place} = {value};"
        for member in model.inputs
        if member.policy in REPLACED
        for place in _places(member, "u")
        for value in values(member, model)
    ]
    if not cases:
        return []
    listed = [f"case {number}: {case} break;" for number, case in enumerate(cases, 1)]
    return [f"switch (Frama_C_interval(0, {len(cases)})) {{", *listed, "default: break;", "}"]


def shown(kind: str, struct: str, members: Iterable[RangedField]) -> Iterator[str]:
    """Lines of C by which Eva prints the range of each real member, as `<kind>_<field>`."""
    for member in members:
        if not member.unsigned:
            any_of = f"[Frama_C_interval(0, {(member.size or 1) - 1})]"
            place = f"{struct}.{member.field}{'' if member.size is None else any_of}"
            yield f"Frama_C_show_each_{kind}_{member.field}({place});"


def _beyond(member: RangedField, model: ExportedC) -> Sequence[str]:
    number = np.float32 if model.dtype == "float32" else np.float64
    largest = float(np.finfo(number).max)
    low, high = member.range or (-math.inf, math.inf)
    found: list[str] = []
    if low > -largest:
        # the neighbours of the limits in the type of the code: what is just outside is among the
        # cases
        found.append(_between(-largest, float(np.nextafter(number(low), number(-np.inf))), model))
    if high < largest:
        found.append(_between(float(np.nextafter(number(high), number(np.inf))), largest, model))
    return found


def _infinite(member: RangedField, model: ExportedC) -> Sequence[str]:
    return "-INFINITY", "INFINITY"


def _between(low: float, high: float, model: ExportedC) -> str:
    kind, suffix = ("float", "f") if model.dtype == "float32" else ("double", "")
    return f"Frama_C_{kind}_interval({low!r}{suffix}, {high!r}{suffix})"


def _places(member: RangedField, struct: str) -> list[str]:
    if member.size is None:
        return [f"{struct}.{member.field}"]
    return [f"{struct}.{member.field}[{index}]" for index in range(member.size)]


# {f} ends the name of a function of <math.h>; `near` allows for rounding, {e} for what is lost
# of numbers of about 1
_BODIES = {
    "exp": "return near(exp{f}(x));",
    "log": "return near(log{f}(x));",
    "pow": "return near(pow{f}(x, y));",
    "sin": "return between(-1.0, 1.0, near(sin{f}(x)));",
    "cos": "return between(-1.0, 1.0, near(cos{f}(x)));",
    "tan": "return near(sin{f}(x) / cos{f}(x));",
    "asin": "/*@ assert -1.0 <= x <= 1.0; */ return any(-1.5707964, 1.5707964);",
    "acos": "/*@ assert -1.0 <= x <= 1.0; */ return any(0.0, 3.1415928);",
    "atan": "return any(-1.5707964, 1.5707964);",
    "atan2": "return any(-3.1415928, 3.1415928);",
    "sinh": "return beyond(x, near((exp{f}(x) - exp{f}(-x)) / 2 + any(-{e}, {e})));",
    "cosh": "return least(1.0, near((exp{f}(x) + exp{f}(-x)) / 2));",
    "tanh": "return any(-1.0, 1.0);",
    "sigmoid": "return any(0.0, 1.0);",
    "softplus": "return near(((x > 0) ? x : 0) + any(0.0, 0.6931472));",
    "sqrt": "return sqrt{f}(x);",
}
KNOWN = frozenset(_BODIES)
_PROTOTYPE = re.compile(r"^(?:float|double) (\w+)\(([^()]*)\);$", re.MULTILINE)


def kernel_bounds(model: ExportedC) -> list[str]:
    """C functions that replace the export's math functions in a proof: they return any value within
    bounds.
    """
    header = model.folder / "src" / f"{model.prefix}_math.h"
    if not header.is_file():
        return []
    single = model.dtype == "float32"
    suffix = "f" if single else ""
    limits = np.finfo(np.float32 if single else np.float64)
    largest, lost = float(limits.max), f"{float(limits.eps):.3g}"
    found: list[str] = []
    for name, arguments in _PROTOTYPE.findall(header.read_text(encoding="utf-8")):
        body = _BODIES.get(name.removeprefix(f"{model.prefix}_"))
        if body is None:
            body = f"return any({-largest!r}, {largest!r});"
        # what a bound does not depend on
        unused = [f"(void){argument.split()[-1]};" for argument in arguments.split(",")]
        real = f"{model.prefix}_real"
        lines = [*unused, body.replace("{f}", suffix).replace("{e}", lost)]
        found.append(
            "\n".join([f"{real} {name}({arguments})", "{", *(f"    {line}" for line in lines), "}"])
        )
    return found
