"""Lists the programs for verification, and their Debian packages."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Tool:
    """A command, or a file that another command needs."""

    command: str
    package: str

    @property
    def is_there(self) -> bool:
        if self is LIBFUZZER:
            return _has_libfuzzer()
        return shutil.which(self.command) is not None


GCC = Tool("gcc", "gcc")
GCOV = Tool("gcov", "gcc")
GPP = Tool("g++", "g++")
NM = Tool("nm", "binutils")
CLANG = Tool("clang", "clang")
CPPCHECK = Tool("cppcheck", "cppcheck")
FRAMA_C = Tool("frama-c", "frama-c-base")
ARM_GCC = Tool("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
ARM_QEMU = Tool("qemu-system-arm", "qemu-system-arm")
RISCV_GCC = Tool("riscv64-unknown-elf-gcc", "gcc-riscv64-unknown-elf")
RISCV_QEMU = Tool("qemu-system-riscv32", "qemu-system-misc")
OPENOCD = Tool("openocd", "openocd")
PYOCD = Tool("pyocd", "python3-pyocd")
# no command: a library of clang, which Debian packs apart, by its version
LIBFUZZER = Tool("libFuzzer", "libclang-rt-14-dev")


@cache
def _has_libfuzzer() -> bool:
    if not CLANG.is_there:
        return False
    asked = ["clang", "-print-resource-dir"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    return any(Path(found.stdout.strip()).glob("lib/**/libclang_rt.fuzzer-*.a"))
