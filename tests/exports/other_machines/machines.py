"""Machines other than this one, on which programs that zig compiles are run: Wine and QEMU."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from backends.c.host.build import compiled
from backends.files.c_compiler import find_compiler
from backends.fmu.binary import (
    HEADERS,
    PLATFORMS,
    Platform,
    this_platform,
    zig_compiler,
    zig_libraries,
)
from tests.conditions import require_package, require_tool

HOST = Path(__file__).with_name("unit_host.c")
LONGEST = 600
"""Seconds: what hangs is a failure."""

BARE = "-s"
"""Programs without symbols, as units are: zig compiles its runtime once for those with and once
for those without."""

ENTRY = HOST.with_name("windows_entry.c")
PARTS = ("stdio", "runtime", "convert", "utility", "environment")
"""What programs call of Windows' C library beside what units do."""
PRINTING = (
    *("printf", "vprintf", "snprintf", "scanf"),
    *("__local_stdio_printf_options", "__local_stdio_scanf_options"),
)
"""What MinGW has a function for that Windows' C library has under another name."""


@dataclass(frozen=True)
class Machine:
    """A kind of machine: what compiles for it, and what runs that here."""

    platform: Platform
    compiler: Sequence[str]
    emulator: Sequence[str] = ()
    linked: Sequence[str] = ("-ldl", "-lm")
    """With programs; Linux has had its loader in a library of its own."""

    def unit_host(self, folder: Path) -> Path:
        """The program that loads units, which `unit_script.py` writes scripts for."""
        options = ["-std=c99", "-O1", BARE, "-D_POSIX_C_SOURCE=200809L", f"-I{HEADERS}"]
        program = folder / f"{self.platform.fmi3}.exe"
        return compiled([*self.compiler, *options, str(HOST)], program, *self.linked)

    def self_test(self, folder: Path, program: Path) -> Path:
        """The test program of exported C."""
        texts = (path for part in ("src", "test") for path in (folder / part).glob("*.c"))
        return self.program(folder, sorted(texts), program)

    def program(self, folder: Path, texts: Sequence[Path], program: Path) -> Path:
        """A program of files that include headers of exported C."""
        options = ["-std=c99", "-O2", BARE, "-ffp-contract=off", f"-I{folder / 'include'}"]
        return compiled([*self.compiler, *options, *map(str, texts)], program, *self.linked)

    def said(self, program: Path, *arguments: str, script: str = "") -> str:
        """What a program prints, and a last line with its exit code where that is not 0."""
        # Wine tells of whatever a machine without a screen lacks
        environment = {**os.environ, "WINEDEBUG": "-all"}
        done = subprocess.run(
            [*self.emulator, str(program), *arguments],
            input=script.encode(),
            capture_output=True,
            check=False,
            env=environment,
            timeout=LONGEST,
        )
        text = done.stdout.decode().replace("\r\n", "\n")
        return text if done.returncode == 0 else f"{text}exit code {done.returncode}\n"


def this_machine() -> Machine:
    platform = this_platform()
    assert platform is not None
    return Machine(platform, find_compiler())


def windows() -> Machine:
    """x86-64 by Wine."""
    require_package("ziglang", "make setup")
    platform = PLATFORMS["x86_64-windows"]
    emulator = require_tool("wine", "apt install wine64 wine")
    libraries = (f"-lapi-ms-win-crt-{part}-l1-1-0" for part in PARTS)
    printing = (str(zig_libraries() / "mingw" / "stdio" / f"ucrt_{name}.c") for name in PRINTING)
    entry = (str(ENTRY), "-Wl,--entry=mainCRTStartup")
    linked = (*entry, *printing, "-lkernel32", *libraries)
    compiler = (*zig_compiler(platform), "-D__USE_MINGW_ANSI_STDIO=0")
    return Machine(platform, compiler, (emulator,), linked)


def aarch64() -> Machine:
    """AArch64 with Linux by QEMU, and the C library of the cross compiler."""
    require_package("ziglang", "make setup")
    require_tool("aarch64-linux-gnu-gcc", "apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross")
    emulator = require_tool("qemu-aarch64", "apt install qemu-user")
    platform = PLATFORMS["aarch64-linux"]
    return Machine(platform, zig_compiler(platform), (emulator, "-L", "/usr/aarch64-linux-gnu"))
