"""What build systems want beside the sources: Zephyr, Arduino and CMake find the same files."""

from __future__ import annotations

from collections.abc import Sequence

from backends.c.interface import Interface
from backends.c.rendering import render
from spec_schema.version import __version__


def package_texts(interface: Interface, sources: Sequence[str]) -> dict[str, str]:
    """Texts by path in the folder; `sources` are the paths of the C files in it."""
    files = {
        "CMakeLists.txt": "CMakeLists.txt.j2",
        "zephyr/module.yml": "packages/zephyr_module.yml.j2",
        "zephyr/Kconfig": "packages/zephyr_Kconfig.j2",
        "zephyr/CMakeLists.txt": "packages/zephyr_CMakeLists.txt.j2",
        "library.properties": "packages/library.properties.j2",
        f"src/{interface.prefix}.h": "packages/forward.h.j2",
    }
    return {
        path: render(template, interface, "Interface", sources=sources, version=__version__)
        for path, template in files.items()
    }
