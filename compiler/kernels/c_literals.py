"""C text of types, numbers and tables."""

from __future__ import annotations

from typing import assert_never

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import Kind, Table

_TABLE_WIDTH = 88


def c_kind(kind: Kind, format: Format) -> str:
    """The C type of a value."""
    match kind:
        case Kind.REAL:
            return format.c_type
        case Kind.UNSIGNED:
            return "uint32_t"
        case Kind.WIDE:
            return "uint64_t"
        case Kind.TRUTH:
            return "bool"
        case _:
            assert_never(kind)


def literal(value: float, format: Format) -> str:
    """A real as a C literal: short decimals as they are, others exactly in hexadecimal."""
    if abs(value) < 1000 and value == int(value * 64) / 64:
        return f"{value!r}{format.c_suffix}"
    mantissa, _, exponent = value.hex().partition("p")
    shortened = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{shortened}p{exponent}{format.c_suffix}"


def table_lines(table: Table, format: Format) -> list[str]:
    """The declaration of a table inside the function that uses it."""
    kind = c_kind(table.kind, format)
    lines = [f"    static const {kind} {table.name}[{len(table.values)}] = {{"]
    line = ""
    for value in table.values:
        if table.kind is Kind.REAL:
            text = literal(float(value), format)
        else:
            text = unsigned_literal(int(value), "U")
        if line and len(line) + len(text) + 2 > _TABLE_WIDTH:
            lines.append(f"        {line}")
            line = ""
        line += f" {text}," if line else f"{text},"
    lines.append(f"        {line.rstrip(',')}")
    lines.append("    };")
    return lines


def unsigned_literal(value: int, suffix: str) -> str:
    """An unsigned C literal, in hexadecimal where it is long."""
    return f"{value}{suffix}" if value < 1000 else f"0x{value:X}{suffix}"


def bare(text: str) -> str:
    """An expression without a pair of parentheses around the whole of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for position, character in enumerate(text):
        depth += {"(": 1, ")": -1}.get(character, 0)
        if depth == 0 and position < len(text) - 1:
            return text
    return text[1:-1]
