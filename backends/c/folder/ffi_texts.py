"""Writes the Python file that calls generated code, and the C loop over steps for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.c_language.rendering import Generated, render


def ffi_texts(
    interface: Generated, numbers: Mapping[str, str], *, linearizes: bool = False
) -> dict[str, str]:
    """Texts by path in the folder; `numbers` maps the layout's number types to ctypes."""
    # the type names of the JSON file, from which the Python file builds its structs
    types = {**numbers, "uint32": "c_uint32"}
    facts: dict[str, Any] = {"types": types, "words": "word" in numbers, "jacobian": linearizes}
    return {
        f"{interface.prefix}_ffi.py": render("ffi.py.j2", interface, "", **facts),
        f"{interface.prefix}_ffi.c": render("ffi.c.j2", interface, "Many steps at once"),
    }
