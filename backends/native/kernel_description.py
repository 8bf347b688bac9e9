"""Describes the compiler of kernels and the instruction sets that it uses."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cache

from backends.files.c_compiler import CompilerMissingError, find_compiler, installed_as
from backends.files.run_compiler import CompilerTooSlowError, run_compiler
from backends.native.compile_kernel import kernel_flags

_FEATURES = {
    "__FMA__": "FMA",
    "__AVX2__": "AVX2",
    "__AVX512F__": "AVX-512",
    "__aarch64__": "AArch64",
    "__FP_FAST_FMAF": "FMA",
}
"""Macros of gcc and clang for instruction sets that affect a kernel's speed or bits."""

_FUSE = {"FMA", "AArch64"}
"""Features for which templates/native/prelude.c defines HAS_FMA."""

_SECONDS = 30.0
"""Time limit, far above the usual time."""


@dataclass(frozen=True, slots=True)
class KernelDescription:
    """The compiler and the processor features of kernels on this machine."""

    compiler: str
    command: str
    flags: tuple[str, ...]
    features: tuple[str, ...]

    @property
    def fuses(self) -> bool:
        """True if a·b + c is one instruction, so that bits equal those of other such processors."""
        return not _FUSE.isdisjoint(self.features)


def kernel_description() -> KernelDescription | None:
    """The description; None without a working compiler."""
    try:
        compiler = find_compiler()
        told = _macros(compiler, installed_as(compiler))
    except (CompilerMissingError, CompilerTooSlowError, OSError):
        return None
    macros = dict(re.findall(r"^#define (\w+) ?(.*)$", told, re.MULTILINE))
    # clang also defines the macros of gcc
    family = "clang" if "__clang__" in macros else "gcc"
    version = macros.get("__VERSION__", "").strip('"').strip()
    found = dict.fromkeys(name for macro, name in _FEATURES.items() if macro in macros)
    return KernelDescription(
        compiler=version if family in version.lower() else f"{family} {version}",
        command=shlex.join(compiler),
        flags=kernel_flags(compiler, on_lanes=True),
        features=tuple(found),
    )


@cache
def _macros(compiler: tuple[str, ...], file: tuple[int, ...]) -> str:
    """The macros of the compiler with the flags of kernels, cached while its file does not
    change.
    """
    del file
    command = [*compiler, *kernel_flags(compiler, on_lanes=True), "-dM", "-E", "-x", "c", "-"]
    told = run_compiler(command, longest=_SECONDS)
    if told.code != 0:
        raise CompilerMissingError(f"`{shlex.join(compiler)}` says nothing of itself")
    return told.output
