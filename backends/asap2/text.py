"""Writes a model as an ASAP2 file in which all addresses are still 0."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

from backends.asap2.objects import (
    CalibratedModel,
    Knots,
    MemoryObject,
    Scale,
    Segment,
    Storage,
    Struct,
)
from backends.files.export_identity import OPEN
from backends.ports.identifiers import ascii_text

# what an ECU's type can hold, where the spec has no range: ASAP2 wants limits of everything
_LARGEST: dict[Storage, float] = {
    "FLOAT32_IEEE": 3.4028234663852886e38,
    "FLOAT64_IEEE": 1.7976931348623157e308,
    "SWORD": 2.0**15,
    "SLONG": 2.0**31,
    "A_INT64": 2.0**63,
    "ULONG": 2.0**32,
}
_GROUPS: dict[Struct, str] = {
    "params": "parameters",
    "in": "inputs of a step",
    "out": "outputs of a step",
    "state": "states before the next step",
    "calibration": "checksum of the parameters",
}
_Order: TypeAlias = Literal["ROW_DIR", "COLUMN_DIR"]
_Layout: TypeAlias = tuple[Storage, _Order]
_LAYOUTS: dict[_Order, str] = {"ROW_DIR": "rows", "COLUMN_DIR": "columns"}


def a2l_text(model: CalibratedModel) -> str:
    """The text of an ASAP2 file (A2L) for a model, in plain ASCII; the same model gives the same
    text. All addresses are 0: `SYMBOL_LINK` names type and member, and the variable is later taken
    from an ELF file.
    """
    names = _names(model)
    scales = list(dict.fromkeys(_scales(model)))
    # equal scales share a method: tools list them
    methods = {scale: f"{model.prefix}.CM{number}" for number, scale in enumerate(scales, 1)}
    used: list[_Layout] = [(entry.storage, _order(entry)) for entry in _parameters(model)]
    lines = [
        # */ in a name would end the comment
        f"/* {_plain(model.name).replace('*/', '* /')}: made by msnn. {model.remark} */",
        "ASAP2_VERSION 1 71",
        f"/begin PROJECT {model.prefix} {quoted(model.doc)}",
        f"/begin MODULE {model.prefix} {quoted(model.doc)}",
        '/begin MOD_PAR ""',
        f"  VERSION {quoted(model.version)}",
        # a tool compares it with the image, once the file has its address
        f"  EPK {quoted(OPEN)}",
        *_segment(model.segment),
        "/end MOD_PAR",
        '/begin MOD_COMMON ""',
        "  BYTE_ORDER MSB_LAST",
        "/end MOD_COMMON",
    ]
    for storage, order in dict.fromkeys(used):
        lines += [
            f"/begin RECORD_LAYOUT {_layout(model, storage, order)}",
            # row or column: which index runs fastest, in ASAP2's words
            f"  FNC_VALUES 1 {storage} {order} DIRECT",
            "/end RECORD_LAYOUT",
        ]
    for scale, method in methods.items():
        lines += _method(method, scale)
    for member in model.objects:
        if member.struct == "params":
            lines += _characteristic(model, member, names, methods)
        else:
            lines += _measurement(model, member, names, methods)
    for struct, title in _GROUPS.items():
        lines += _group(model, struct, title, names)
    return "\n".join([*lines, "/end MODULE", "/end PROJECT"]) + "\n"


def _segment(segment: Segment | None) -> list[str]:
    """The lines of a memory segment, none for None. The segment has the name of its variable's
    type, by which its address is found later.
    """
    if segment is None:
        return []
    about = quoted(f"section {segment.section}")
    place = f"0x0 0x{segment.size:X} -1 -1 -1 -1 -1"
    return [
        f"  /begin MEMORY_SEGMENT {segment.type} {about} DATA RAM INTERN {place}",
        "  /end MEMORY_SEGMENT",
    ]


def quoted(text: str) -> str:
    """The text as an ASAP2 string in quotes: one line of printable ASCII."""
    return '"' + _plain(text).replace("\\", "\\\\").replace('"', '\\"') + '"'


def _plain(text: str) -> str:
    """The text as one line of printable ASCII."""
    line = " ".join(ascii_text(text).split())
    # ASAP2 is a format of bytes: only ASCII is the same to all tools
    return "".join(character if character.isprintable() else " " for character in line)


def _number(value: float) -> str:
    return repr(float(value))


def _names(model: CalibratedModel) -> dict[tuple[Struct, str], str]:
    """The ASAP2 name of each object, `prefix.name`, by struct and member. The prefix keeps them
    different from keywords and from names of other models; equal ones get `_` appended.
    """
    found: dict[tuple[Struct, str], str] = {}
    taken = {f"{model.prefix}.CM{number}" for number in range(1, len(model.objects) + 1)}
    # dots are allowed between identifiers; anything else in a name is written as C has it
    for entry in model.objects:
        parts = entry.name.split(".")
        fits = all(part.isascii() and part.isidentifier() for part in parts)
        name = f"{model.prefix}.{entry.name if fits else entry.member}"
        while name in taken:
            name += "_"
        taken.add(name)
        found[entry.struct, entry.member] = name
    return found


def _parameters(model: CalibratedModel) -> Iterable[MemoryObject]:
    return (entry for entry in model.objects if entry.struct == "params")


def _scales(model: CalibratedModel) -> Iterable[Scale]:
    for entry in model.objects:
        yield entry.scale
        yield from (Scale(knots.unit) for knots in entry.knots)


def _order(entry: MemoryObject) -> _Order:
    """The order of an array in memory: by columns for curves and maps, by rows for other arrays.
    The first axis of a map is x, and C stores the values of each x together. In other arrays x is
    the last axis, along which adjacent elements lie.
    """
    return "COLUMN_DIR" if entry.knots else "ROW_DIR"


def _layout(model: CalibratedModel, storage: Storage, order: _Order) -> str:
    return f"{model.prefix}.{storage}_{_LAYOUTS[order]}"


def _method(name: str, scale: Scale) -> list[str]:
    unit = quoted(scale.unit)
    if scale.factor is None:
        return [f'/begin COMPU_METHOD {name} "" IDENTICAL "%12.6" {unit}', "/end COMPU_METHOD"]
    return [
        f'/begin COMPU_METHOD {name} "" LINEAR "%12.6" {unit}',
        # physical = a · stored + b, the opposite direction of RAT_FUNC, whose coefficients lead to
        # stored
        f"  COEFFS_LINEAR {_number(scale.factor)} 0",
        "/end COMPU_METHOD",
    ]


def _limits(entry: MemoryObject) -> str:
    # ASAP2 has no infinity: an open side ends where the storage does, in physical numbers
    largest = _LARGEST[entry.storage] * (entry.scale.factor or 1.0)
    low = entry.low if math.isfinite(entry.low) else -largest
    high = entry.high if math.isfinite(entry.high) else largest
    return f"{_number(low)} {_number(high)}"


def _dims(entry: MemoryObject) -> str:
    """The line with the lengths of up to three axes, x (the last axis in C) first. An array with
    more than three axes has one axis of all elements.
    """
    # ASAP2 counts x first, and x runs fastest: C has the last axis so
    shape = entry.shape[::-1] if len(entry.shape) <= 3 else (entry.size,)
    return "MATRIX_DIM " + " ".join(str(size) for size in (*shape, 1, 1)[:3])


def _about(entry: MemoryObject) -> str:
    order = " x ".join(f"{name or 'element'} {size}" for name, size in entry.axes)
    shown = order if len(entry.axes) > 1 else ""
    return quoted("; ".join(part for part in (_plain(entry.doc), shown) if part))


def _link(model: CalibratedModel, entry: MemoryObject) -> str:
    return f'  SYMBOL_LINK "{model.prefix}_{entry.struct}_t.{entry.member}" 0'


def _characteristic(
    model: CalibratedModel,
    entry: MemoryObject,
    names: dict[tuple[Struct, str], str],
    methods: dict[Scale, str],
) -> list[str]:
    # by axes that have knots: a matrix without them is a block of values to tools
    kind = {0: "VAL_BLK" if entry.shape else "VALUE", 1: "CURVE", 2: "MAP"}[len(entry.knots)]
    layout = _layout(model, entry.storage, _order(entry))
    lines = [
        f"/begin CHARACTERISTIC {names[entry.struct, entry.member]} {_about(entry)}",
        # addresses are known once the program is linked: until then a tool finds the symbol below
        f"  {kind} 0x0 {layout} 0 {methods[entry.scale]} {_limits(entry)}",
    ]
    # what a tool can show on the axis while the unit runs: a step reads these
    read = {o.name: names[o.struct, o.member] for o in model.objects if o.struct in ("in", "state")}
    for knots in entry.knots:
        lines += _axis(knots, read, methods[Scale(knots.unit)])
    if kind == "VAL_BLK":
        lines.append(f"  {_dims(entry)}")
    return [*lines, _link(model, entry), "/end CHARACTERISTIC"]


def _axis(knots: Knots, measured: dict[str, str], method: str) -> list[str]:
    values = knots.values
    read = measured.get(knots.of or "", "NO_INPUT_QUANTITY")
    limits = f"{_number(values[0])} {_number(values[-1])}"
    return [
        # fixed: knots are constants of the code, which a tool shows and cannot move
        f"  /begin AXIS_DESCR FIX_AXIS {read} {method} {len(values)} {limits}",
        "    /begin FIX_AXIS_PAR_LIST",
        *(f"      {_number(value)}" for value in values),
        "    /end FIX_AXIS_PAR_LIST",
        "  /end AXIS_DESCR",
    ]


def _measurement(
    model: CalibratedModel,
    entry: MemoryObject,
    names: dict[tuple[Struct, str], str],
    methods: dict[Scale, str],
) -> list[str]:
    dims = [f"  {_dims(entry)}", "  LAYOUT ROW_DIR"] if entry.shape else []
    return [
        f"/begin MEASUREMENT {names[entry.struct, entry.member]} {_about(entry)}",
        f"  {entry.storage} {methods[entry.scale]} 0 0 {_limits(entry)}",
        "  ECU_ADDRESS 0x0",
        *dims,
        _link(model, entry),
        "/end MEASUREMENT",
    ]


def _group(
    model: CalibratedModel, struct: Struct, title: str, names: dict[tuple[Struct, str], str]
) -> list[str]:
    members: Sequence[str] = [
        names[entry.struct, entry.member] for entry in model.objects if entry.struct == struct
    ]
    if not members:
        return []
    block = "REF_CHARACTERISTIC" if struct == "params" else "REF_MEASUREMENT"
    return [
        f"/begin GROUP {model.prefix}.{struct}_t {quoted(title)}",
        "  ROOT",
        f"  /begin {block}",
        *(f"    {member}" for member in members),
        f"  /end {block}",
        "/end GROUP",
    ]
