"""Builds a kernel once: source, flags, compiler and processor decide the file it is kept in."""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shlex
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from backends.files.c_compiler import CompilerMissingError, find_compiler, installed_as
from backends.files.compiler_words import complaints
from backends.files.run_compiler import CompilerTooSlowError, Finished, has_room, run_compiler
from backends.native.kernel_cache.folders import candidates, opened
from backends.native.kernel_cache.stored_kernel import StoredKernel

FLAGS = (
    "-std=gnu11",
    "--param=lra-max-considered-reload-pseudos=50",
    "-march=native",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-Wno-psabi",
    "-pthread",
    "-shared",
    "-fPIC",
)
"""Never -ffast-math: gcc then links code that turns denormals off in the whole process, NaN cannot
be told from numbers, and the math kernels lose the roundings they are made of. Nor contraction:
each compiler fuses other products. The emitter itself writes long sums as several short ones, and
`fused` where one rounding is enough (lanes/fused_products.py).

gcc gives registers to the long blocks of large models in about a fifth less of its time where it
looks at 50 values that it might spill instead of 500, and its code is as fast
(benchmarks/kernel_build); clang ignores it."""

FAST = ("-O3", "-funroll-loops")

BRIEF = ("-O0",)
"""For what is called some hundred times: the C of a controller takes gcc a tenth of what it takes
at its highest level, and its golden solves are as quick (decision 393)."""

_MOST_SAID = 10
"""Lines of a compiler: the first mistake is followed by others that come of it."""

LANES_BY_GCC = (
    "-O1",
    "-ftree-vectorize",
    "-fvect-cost-model=dynamic",
    "-fstrict-aliasing",
    "-fipa-ra",
    "-fcaller-saves",
    "-frename-registers",
    "-fpeel-loops",
)
"""How gcc optimises functions on lanes, long blocks of vectors: what of its highest level makes
them faster. The rest of that level takes two fifths of its time and makes more values wait in
memory (decision 292)."""


class KernelBuildError(Exception):
    """The compiler refused a kernel: a bug of the emitter, with the compiler's own words."""


@dataclass(slots=True)
class Built:
    """A loaded kernel, and whether it was found right."""

    library: ctypes.CDLL
    _stored: StoredKernel
    _digest: str
    _checked: bool = False

    @property
    def name(self) -> str:
        """The name of its file in the cache, without the ending."""
        return self._stored.key

    @property
    def is_checked(self) -> bool:
        """Whether somebody compared this kernel with the interpreter."""
        self._checked = self._checked or self._stored.is_checked(self._digest)
        return self._checked

    def mark_checked(self) -> None:
        """Remembers that the comparison went well."""
        self._checked = True
        self._stored.mark_checked(self._digest)


def compiled_kernel(source: str, *, on_lanes: bool = False, briefly: bool = False) -> Built:
    """The loaded kernel of a source, compiled if it was not yet; to be called `briefly` or long.

    The first folder that is trusted and has the kernel or room for it keeps it. Raises
    CompilerMissingError and KernelBuildError.
    """
    compiler = find_compiler()
    command = (*compiler, *kernel_flags(compiler, on_lanes=on_lanes, briefly=briefly))
    # `-march=native` means another processor elsewhere, and caches lie on shared disks
    described = "\n".join((source, *command, _version(compiler), _processor()))
    key = hashlib.sha256(described.encode()).hexdigest()[:32]

    def build(library: Path, folder: Path) -> None:
        _compile(compiler, command, source, library, folder)

    for folder in candidates():
        with suppress(OSError):  # full, closed, or nothing there may be executed
            real, reason = opened(folder)
            if reason is None:
                return _loaded(StoredKernel(real, key), build)
    try:
        # what is loaded stays in memory when its file is gone; Windows leaves the file
        with tempfile.TemporaryDirectory(
            prefix="msnn-kernel-", ignore_cleanup_errors=True
        ) as place:
            return _loaded(StoredKernel(Path(place), key), build)
    except OSError as error:
        raise CompilerMissingError(
            f"no folder takes a kernel ({error.strerror or error})",
            "set MSNN_CACHE to a folder with room",
        ) from None


def kernel_flags(
    compiler: tuple[str, ...], *, on_lanes: bool, briefly: bool = False
) -> tuple[str, ...]:
    """The flags that this compiler makes kernels with. Raises CompilerMissingError."""
    if briefly:
        return (*BRIEF, *FLAGS)
    # gcc goes by many names, and others go by its name, but its copyright is its own
    is_gcc = "Free Software Foundation" in _told(compiler, installed_as(compiler))
    return (*(LANES_BY_GCC if on_lanes and is_gcc else FAST), *FLAGS)


def _loaded(stored: StoredKernel, build: Callable[[Path, Path], None]) -> Built:
    digest = stored.whole() or stored.built(build)
    return Built(stored.load(), stored, digest)


def _compile(
    compiler: tuple[str, ...], command: tuple[str, ...], source: str, library: Path, folder: Path
) -> None:
    """Compiles a source. Raises OSError where the folder is what is wrong."""

    def run(text: str) -> Finished:
        reading = ["-o", str(library), "-x", "c", "-", "-lm"]
        return _ended(compiler, [*command, *reading], text, folder)

    done = run(source)
    if done.code == 0:
        return
    has_room(folder)
    # a compiler that compiles nothing is the user's to mend, one that refuses only this source ours
    said = complaints(done.errors) or [f"it ended with code {done.code}"]
    if run("int answer(void) { return 42; }\n").code != 0:
        raise CompilerMissingError(f"`{shlex.join(compiler)}` compiles nothing ({said[0]})")
    raise KernelBuildError("\n".join(said[:_MOST_SAID]))


def _version(compiler: tuple[str, ...]) -> str:
    return _told(compiler, installed_as(compiler)).partition("\n")[0]


@cache
def _told(compiler: tuple[str, ...], file: tuple[int, ...]) -> str:
    """Asks the compiler for its description, once as long as its file stays."""
    del file
    return _ended(compiler, [*compiler, "--version"]).output


def _ended(
    compiler: tuple[str, ...], command: list[str], source: str = "", folder: Path | None = None
) -> Finished:
    try:
        return run_compiler(command, source, folder)
    except CompilerTooSlowError as error:
        raise CompilerMissingError(f"`{shlex.join(compiler)}` {error}", error.remedy) from None


@cache
def _processor() -> str:
    """The model and features of the processor, on which -march=native depends."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    wanted = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
