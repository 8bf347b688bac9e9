"""Writes package files for Zephyr, Arduino and CMake, all for the same sources."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from backends.c_language.rendering import Generated, render
from spec_schema.version import __version__

NUMBER = ".".join(re.findall(r"\d+", __version__)[:3])
"""The version of msnn as digits only, for build systems."""


def package_texts(
    interface: Generated, paths: Iterable[str], *, in_reals: bool = True
) -> dict[str, str]:
    """Texts by path in the folder; `paths` are the other files in it.

    `in_reals` is False for fixed-point code.
    """
    named = sorted(paths)
    facts: dict[str, Any] = {
        "sources": [path for path in named if path.startswith("src/") and path.endswith(".c")],
        "headers": [path for path in named if path.startswith("include/")],
        "in_reals": in_reals,
        # digits only: CMake and Arduino accept no suffix of a development version
        "version": NUMBER,
    }
    files = {
        "CMakeLists.txt": "CMakeLists.txt.j2",
        "zephyr/module.yml": "packages/zephyr_module.yml.j2",
        "zephyr/Kconfig": "packages/zephyr_Kconfig.j2",
        "zephyr/CMakeLists.txt": "packages/zephyr_CMakeLists.txt.j2",
        "library.properties": "packages/library.properties.j2",
    }
    texts = {path: render(template, interface, "", **facts) for path, template in files.items()}
    return texts | dict(_forward(interface, header) for header in facts["headers"])


def _forward(interface: Generated, header: str) -> tuple[str, str]:
    """A header in `src/` that includes the one in `include/`."""
    name = header.removeprefix("include/")
    guard = f"{name.removesuffix('.h').upper()}_FORWARD_H"
    template = "packages/forward.h.j2"
    # Arduino searches headers in `src/` only; all others use `include/`
    return f"src/{name}", render(template, interface, "Interface", header=header, guard=guard)
