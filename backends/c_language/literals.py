"""Writes numbers as C literals with exactly the same bits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

Dtype = Literal["float32", "float64"]


def real_literal(value: float, dtype: Dtype) -> str:
    """The shortest decimal C literal that gives `value` rounded to dtype: `0.1f`, `-2.0`. NaN and
    infinities are the macros of math.h, also for a value beyond the range of dtype.
    """
    rounded = _rounded(value, dtype)
    special = _special(float(rounded), dtype)
    if special:
        return special
    text = str(rounded)
    if not any(mark in text for mark in ".e"):
        text += ".0"
    return text + suffix(dtype)


def hex_literal(value: float, dtype: Dtype) -> str:
    """`value` rounded to dtype as a hexadecimal C literal, which shows its exact bits:
    `0x1.99999ap-4f`.
    """
    return hex_literals((value,), dtype)[0]


def hex_literals(values: Sequence[float], dtype: Dtype) -> list[str]:
    """Each of the values, rounded to dtype, as a hexadecimal C literal that shows its exact bits.
    Faster than one by one, since golden vectors have thousands.
    """
    with np.errstate(over="ignore"):
        rounded = np.array(values, dtype=np.float64).astype(dtype).astype(np.float64).tolist()
    end = suffix(dtype)
    return [_special(value, dtype) or f"{_hex(value)}{end}" for value in rounded]


def exact_literal(value: float, dtype: Dtype) -> str:
    """A C literal of a number that is exact in dtype: in decimal if short, otherwise in
    hexadecimal.
    """
    # multiples of 1/64 below 1000 have at most six decimals, all of them exact
    if abs(value) < 1000 and value == int(value * 64) / 64:
        return f"{value!r}{suffix(dtype)}"
    return hex_literal(value, dtype)


def suffix(dtype: Dtype) -> str:
    """The suffix of C literals and math functions for that type: `f` for float32, none for
    float64.
    """
    return "f" if dtype == "float32" else ""


def _hex(value: float) -> str:
    mantissa, exponent = value.hex().split("p")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}p{exponent}"


def _rounded(value: float, dtype: Dtype) -> np.floating[Any]:
    with np.errstate(over="ignore"):  # overflow gives infinity
        return np.dtype(dtype).type(value)


def _special(value: float, dtype: Dtype) -> str | None:
    if math.isfinite(value):
        return None
    # the macros are floats: a double program casts them explicitly
    cast = "" if dtype == "float32" else "(double)"
    if math.isnan(value):
        return f"{cast}NAN"
    return f"{'-' if value < 0 else ''}{cast}INFINITY"
