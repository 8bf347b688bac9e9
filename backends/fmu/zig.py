"""The commands of zig, which includes headers and libraries for other platforms."""

from __future__ import annotations

from pathlib import Path

from backends.files.c_compiler import zig_program
from backends.fmu.binary import Platform


def zig_compiler(target: Platform) -> tuple[str, ...]:
    """The command of the wheel `ziglang` for a platform."""
    command = (str(_zig()), "cc", "-target", target.target)
    return (*command, *_without_mingw()) if target.suffix == "dll" else command


def zig_libraries() -> Path:
    """The folder of the wheel with the headers and sources of C libraries."""
    return _zig().parent / "lib" / "libc"


def _zig() -> Path:
    program = zig_program()
    assert program is not None, "its users ask for the wheel first"
    return program


def _without_mingw() -> tuple[str, ...]:
    """Links libraries of Windows itself, as zig has the C library of MinGW only as source code.

    Compiling that takes a minute, and units call nothing of it (decision 0395).
    """
    headers = zig_libraries() / "include" / "any-windows-any"
    libraries = (f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("heap", "string", "math"))
    # zig's own runtime has what compilers call: memcpy, and the probes of large stacks. Loading
    # prepares nothing, so that there is no function for it
    linking = ("-nostdlib", "-rtlib=compiler-rt", "-Wl,--no-entry", *libraries)
    return ("-isystem", str(headers), *linking)
