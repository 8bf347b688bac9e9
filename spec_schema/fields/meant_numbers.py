"""Recognises numbers in the syntax of other languages or tables."""

from __future__ import annotations

import math
import re

from spec_schema.diagnostics.decimal_commas import with_decimal_point
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.errors import schema as errors
from spec_schema.yaml_tree.nodes import Scalar, kind

_LARGEST = 2**31


def no_number(wanted: str, found: Scalar) -> Diagnostic:
    """E0204 for a scalar that is no number, or no integer where one is `wanted`."""
    # what is in quotes is text to YAML
    said = kind(found)
    number = with_decimal_point(found.text) or found.text.strip()
    if found.quoted and _number(number) is not None:
        repair = "remove the quotes" if number == found.text.strip() else f"write `{number}`"
        return errors.wrong_kind(wanted, said, found.span, repair, number)
    meant = None if found.quoted else _meant(found.text, is_integer=wanted == "an integer")
    repair = None if meant is None else f"write `{meant}`"
    # YAML takes `5#mm` for text: a comment needs a blank before it
    if meant is not None and "#" in meant:
        repair = f"{repair}: a comment begins with a blank and `#`"
    return errors.wrong_kind(wanted, said, found.span, repair, meant)


def _meant(text: str, *, is_integer: bool) -> str | None:
    """`1000` for `1_000`, `1000;`, of integers `1e3`; `0.01` for `1 %`, `0,01`; a comment apart."""
    number, mark, comment = text.partition("#")
    if mark and _number(number) is not None:
        return f"{number} #{comment}"
    # digits grouped by underscores, and what ends a line elsewhere
    plain = re.sub(r"(?<=\d)_(?=\d)", "", text).rstrip(";, ")
    plain = with_decimal_point(plain) or plain
    # a share is written as a number here: `%` is a unit, of quantities alone
    percent = re.fullmatch(r"([\d.]+)\s*%", plain)
    value = _number(plain if percent is None else percent[1])
    if value is None:
        return None
    if percent is not None:
        return None if is_integer else f"{value / 100:g}"
    if not is_integer:
        return plain
    # `1e3` is a float to YAML 1.2, and means an integer here
    return f"{int(value)}" if value.is_integer() and abs(value) < _LARGEST else None


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
