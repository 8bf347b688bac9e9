"""Compiles the sources of a unit for this machine, under the file names that FMI prescribes."""

from __future__ import annotations

import platform
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import templates
from backends.c.host.build import link_library
from backends.files.atomic_write import naming
from backends.files.c_compiler import zig_program
from backends.fmu.sources import Version

HEADERS = Path(templates.__path__[0]) / "fmu" / "headers"
"""The FMI headers, as the standard publishes them."""

# no contraction: fused products would round otherwise than the judge; hidden names: two units in
# one process must not share symbols
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden")


@dataclass(frozen=True, slots=True)
class Platform:
    """An operating system and processor for which a unit can contain a binary, with the names of
    folders and files. `fmi3` is the folder in FMI 3.0, `suffix` that of a shared library.
    """

    fmi2: str | None
    """The folder of the binary in FMI 2.0; None if FMI 2.0 has no name for the platform."""
    fmi3: str
    suffix: str
    target: str
    """The target name of zig, with the oldest supported C library or system version."""

    def path(self, version: Version, prefix: str) -> str | None:
        """The path of the binary in the archive of this FMI version; None if that version has no
        name for the platform. `prefix` is the name of the model in C.
        """
        folder = self.fmi2 if version == 2 else self.fmi3
        return None if folder is None else f"binaries/{folder}/{prefix}.{self.suffix}"


_KNOWN = (
    # glibc 2.17: binaries run on systems that old
    Platform("linux64", "x86_64-linux", "so", "x86_64-linux-gnu.2.17"),
    Platform(None, "aarch64-linux", "so", "aarch64-linux-gnu.2.17"),
    Platform("win64", "x86_64-windows", "dll", "x86_64-windows-gnu"),
    # macOS 11: the first for both processors
    Platform("darwin64", "x86_64-darwin", "dylib", "x86_64-macos.11.0"),
    Platform(None, "aarch64-darwin", "dylib", "aarch64-macos.11.0"),
)
PLATFORMS = {platform.fmi3: platform for platform in _KNOWN}
"""The platforms by their FMI 3.0 names."""


def this_platform() -> Platform | None:
    """The platform of this machine; None if `PLATFORMS` lacks it, or if Python is 32-bit.

    FMI 2.0 has no name for AArch64. There `fmi2` is the name for x86-64 with the same operating
    system, such as `linux64`: importers on AArch64 look for a binary in that folder.
    """
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform)
    machine = {"x86_64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}.get(
        platform.machine().lower()
    )
    # 32-bit Python would load no 64-bit library
    if system is None or machine is None or sys.maxsize < 2**32:
        return None
    found = PLATFORMS.get(f"{machine}-{system}")
    return found and replace(found, fmi2=PLATFORMS[f"x86_64-{system}"].fmi2)


def binary(sources: Mapping[str, str], compiler: Sequence[str], name: str) -> bytes:
    """Compiles sources (file name → text, all in one folder) to a shared library; returns its
    bytes. `compiler` is a command, `name` the file name of the library. Raises CompilerFailedError,
    and OSError for a full disk.
    """
    with tempfile.TemporaryDirectory(prefix="msnn-fmu-") as place:
        folder = Path(place)
        for file, text in sources.items():
            with naming(folder / file):
                (folder / file).write_text(text, encoding="utf-8")
        texts = sorted(folder.glob("*.c"))
        linking = ["-s"]  # the symbols of a build have no place in an archive
        if name.endswith(".dylib"):
            # without one it takes the path of this folder, which differs each time
            linking.append(f"-Wl,-install_name,@rpath/{name}")
        library = link_library(
            [*compiler, *FLAGS], texts, [HEADERS, folder], folder / name, *linking
        )
        return library.read_bytes()


def zig_compiler(target: Platform) -> tuple[str, ...]:
    """The command of the compiler in the wheel `ziglang`, which must be installed, for a
    platform.
    """
    command = (str(_zig()), "cc", "-target", target.target)
    return (*command, *_without_mingw()) if target.suffix == "dll" else command


def zig_libraries() -> Path:
    """The folder of the wheel `ziglang`, which must be installed, with headers and sources of C
    libraries.
    """
    return _zig().parent / "lib" / "libc"


def _zig() -> Path:
    program = zig_program()
    assert program is not None, "its users ask for the wheel first"
    return program


def _without_mingw() -> tuple[str, ...]:
    """Compiler flags for Windows that link its own C library, as zig has that of MinGW only as
    source code. Compiling that takes a minute, and units call nothing of it (decision 0395).
    """
    headers = zig_libraries() / "include" / "any-windows-any"
    libraries = (f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("heap", "string", "math"))
    # zig's own runtime has what compilers call: memcpy, and the probes of large stacks. Loading
    # prepares nothing, so that there is no function for it
    linking = ("-nostdlib", "-rtlib=compiler-rt", "-Wl,--no-entry", *libraries)
    return ("-isystem", str(headers), *linking)
