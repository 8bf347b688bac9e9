"""Generates C code that draws the assumed states and inputs of a proof."""

from __future__ import annotations

import math
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
    """C code that draws any value of the range."""
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
    """C code that shows all elements of each real field as `<kind>_<field>`."""
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
