"""Writes the sources with the trained values: constants, or a tunable variable."""

from __future__ import annotations

import zlib

import numpy as np

from backends.c.functions.function_writer import Weights
from backends.c.interface.interface import Interface
from backends.c_language.comments import comment_text
from backends.c_language.literals import real_literal
from backends.c_language.printer import Printer
from backends.c_language.rendering import render


def parameters_text(interface: Interface, weights: Weights) -> str:
    """`src/<prefix>_params.c`: the values as constants."""
    fields = _fields(interface, weights, "    ")
    return render("params.c.j2", interface, "Trained values", fields=fields)


def calibration_text(interface: Interface, weights: Weights) -> str:
    """`src/<prefix>_calibration.c`: the values in a separate section, with their checksum."""
    return render(
        "calibration.c.j2",
        interface,
        "Values for calibration",
        # one level deeper: the values are a struct next to their checksum
        fields=_fields(interface, weights, "        "),
        section=interface.calibration_section,
        checksum=f"0x{_checksum(interface, weights):08X}",
        count=sum(field.size for field in interface.parameters),
        word="uint32_t" if interface.options.dtype == "float32" else "uint64_t",
    )


def _checksum(interface: Interface, weights: Weights) -> int:
    """CRC-32 of the values in little-endian order, independent of the target."""
    order = "<f4" if interface.options.dtype == "float32" else "<f8"
    # in the order of the struct's fields; all elements have one type, so there is no padding
    numbers = [np.asarray(weights[field.name]).ravel() for field in interface.parameters]
    return zlib.crc32(np.concatenate(numbers).astype(order).tobytes())


def _fields(interface: Interface, weights: Weights, indent: str) -> list[dict[str, str]]:
    dtype = interface.options.dtype
    printer = Printer(interface.prefix, dtype)
    fields: list[dict[str, str]] = []
    for field in interface.parameters:
        numbers = [real_literal(float(value), dtype) for value in weights[field.name].ravel()]
        value = printer.braced(numbers, indent) if field.shape else numbers[0]
        fields.append({"name": comment_text(field.name), "value": value})
    return fields
