"""Finds installed dependencies, and the commands to install missing ones."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from backends.files.c_compiler import CompilerMissingError, find_compiler
from msnn.packages import OPTIONAL, ZIGLANG
from spec_schema.plugins import Plugins
from spec_schema.version import __version__


@dataclass(frozen=True)
class InstalledPart:
    """One dependency: its purpose, the installed version, and the install command if missing."""

    name: str
    purpose: str
    found: str | None
    install: str | None = None


def installation() -> Iterator[InstalledPart]:
    """Every dependency, found without importing it."""
    yield InstalledPart("msnn", "", __version__)
    yield InstalledPart(
        "python", "", f"{platform.python_version()} on {platform.platform(terse=True)}"
    )
    yield _compiler()
    yield InstalledPart("numpy", "arithmetic", _version("numpy"))
    for package in OPTIONAL:
        yield InstalledPart(package.name, package.purpose, _version(package.name), package.install)


def plugin_parts(plugins: Plugins) -> Iterator[InstalledPart]:
    """The plug-ins, and what each brings."""
    for plugin in plugins.found:
        brings = ", ".join(f"{kind} {name}" for kind, name in sorted(plugin.keys))
        yield InstalledPart(plugin.package, f"plug-in: {brings or 'nothing'}", plugin.version)


def plugin_values(plugins: Plugins) -> list[dict[str, Any]]:
    """The plug-ins as JSON: package, version, and kind and name of all that each brings."""
    return [
        {
            "package": plugin.package,
            "version": plugin.version,
            "brings": [{"kind": kind, "name": name} for kind, name in sorted(plugin.keys)],
        }
        for plugin in plugins.found
    ]


def _compiler() -> InstalledPart:
    purpose = "native training kernels, tests of exported C"
    try:
        command = find_compiler()
    except CompilerMissingError:
        return InstalledPart("C compiler", purpose, None, f"apt install gcc, or {ZIGLANG.install}")
    return InstalledPart("C compiler", purpose, " ".join(command))


def _version(package: str) -> str | None:
    try:
        # from the metadata: importing torch to ask it takes seconds
        return version(package)
    except PackageNotFoundError:
        return None
