"""The Python file that calls generated code, and the loop over steps that it calls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.c.rendering import Generated, render


def ffi_texts(interface: Generated, numbers: Mapping[str, str]) -> dict[str, str]:
    """Texts by path in the folder; `numbers` are ctypes of the number types in the layout."""
    facts: dict[str, Any] = {"types": {**numbers, "uint32": "c_uint32"}, "words": "word" in numbers}
    return {
        f"{interface.prefix}_ffi.py": render("ffi.py.j2", interface, "", **facts),
        f"{interface.prefix}_ffi.c": render("ffi.c.j2", interface, "Many steps at once"),
    }
