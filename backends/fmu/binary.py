"""Compiles the sources of a unit for this machine, under the names that FMI has for it."""

from __future__ import annotations

import platform
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import templates
from backends.c.host.build import compile_with
from backends.fmu.sources import Version

HEADERS = Path(templates.__path__[0]) / "fmu" / "headers"
"""FMI's own, as the standard publishes them."""

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared")


@dataclass(frozen=True, slots=True)
class Platform:
    """What binaries for a kind of machine are called."""

    fmi2: str
    fmi3: str
    suffix: str

    def path(self, version: Version, prefix: str) -> str:
        """Where the binary stands in the archive."""
        folder = self.fmi2 if version == 2 else self.fmi3
        return f"binaries/{folder}/{prefix}.{self.suffix}"


def this_platform() -> Platform | None:
    """That of this machine; None where FMI has no name for it."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform)
    machine = {"x86_64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}.get(
        platform.machine().lower()
    )
    if system is None or machine is None or sys.maxsize < 2**32:
        return None
    names = {
        "linux": ("linux64", "so"),
        "darwin": ("darwin64", "dylib"),
        "windows": ("win64", "dll"),
    }
    folder, suffix = names[system]
    return Platform(folder, f"{machine}-{system}", suffix)


def binary(sources: Mapping[str, str], compiler: Sequence[str]) -> bytes:
    """A shared library of these files. Raises CompilerFailedError."""
    return _compiled(tuple(sorted(sources.items())), tuple(compiler))


@lru_cache(maxsize=8)  # one model is often written again: entries of `validate`, tests
def _compiled(sources: tuple[tuple[str, str], ...], compiler: tuple[str, ...]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="msnn-fmu-") as place:
        folder = Path(place)
        for name, text in sources:
            (folder / name).write_text(text, encoding="utf-8")
        library = folder / "unit.library"
        texts = [str(folder / name) for name, _ in sources if name.endswith(".c")]
        arguments = ["-s", f"-I{HEADERS}", f"-I{folder}", *texts]
        compile_with([*compiler, *FLAGS], arguments, library)
        return library.read_bytes()
