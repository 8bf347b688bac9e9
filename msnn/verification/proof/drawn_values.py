"""Assumes, as C that draws them, the states and inputs of a step that is proved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from msnn.verification.exported_c import ExportedC, Range, RangedField

ASSUMED = 1e6
"""Magnitude of a value for which the spec declares no range; the report names each."""

REPLACED = ("clamp", "hold")
"""Policies that take any float."""


def assumed_range(member: RangedField, model: ExportedC) -> Range:
    """The range of a state or an input, rounded as the generated code rounds it."""
    low, high = member.range or (-ASSUMED, ASSUMED)
    number = np.float32 if model.dtype == "float32" else np.float64
    # a limit in float32 may lie outside the spec's: the code compares with this one
    return float(number(low)), float(number(high))


def drawn(struct: str, members: Iterable[RangedField], model: ExportedC) -> Iterator[str]:
    """Any value of its range."""
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
    """Then, where a policy replaces it: no input or one of them anywhere beyond its range.

    One at a time is enough: each is replaced by itself, by a value that was drawn before. The
    finite numbers or the infinities; empty where no policy replaces any. Each is a case of its own,
    because Eva follows a test of the input to the copy that the step corrects in no other way.
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
    """Shows all elements of each real field as one, under `<kind>_<field>`."""
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
