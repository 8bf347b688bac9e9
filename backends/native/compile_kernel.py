"""Builds kernels, and describes the compiler and the instruction sets that they use.

The cache key consists of source, flags, compiler and processor.

"""

from __future__ import annotations

import ctypes
import hashlib
import platform
import re
import shlex
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from backends.files.c_compiler import (
    CompilerMissingError,
    CompilerTooSlowError,
    Finished,
    complaints,
    find_compiler,
    has_room,
    installed_as,
    run_compiler,
)
from backends.native.kernel_cache import StoredKernel, candidates, opened

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
"""No -ffast-math: gcc would link code that flushes denormals in the whole process, NaN tests would
fail, and the math kernels would lose their exact roundings. No contraction: each compiler fuses
other products. The emitter itself splits long sums, and writes `fused` where one rounding is enough
(lane_kernels.py).

The `lra` parameter limits gcc to 50 candidates for spilling instead of 500. For large models it
then needs about a fifth less time, and the code is as fast (benchmarks/kernel_build). clang ignores
the flag."""

FAST = ("-O3", "-funroll-loops")

BRIEF = ("-O0",)
"""For code that is called some hundred times. gcc compiles the C of a controller in a tenth of
the time of its highest level, and golden solves are as fast (decision 0393)."""

_MOST_SAID = 10
"""Maximum number of compiler messages: later errors follow from the first."""

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
"""gcc flags for functions on lanes, i.e. long blocks of vector code: the useful part of -O3. The
rest of that level takes two fifths of its time and causes more spilling (decision 0292)."""


class KernelBuildError(Exception):
    """The compiler works but rejected a kernel, which is a bug of the code generator. The message
    has the first lines of the compiler's messages.
    """


@dataclass(slots=True)
class Built:
    """A kernel loaded into this process. A mark in the cache shows that it has agreed with the
    reference interpreter once.
    """

    library: ctypes.CDLL
    _stored: StoredKernel
    _digest: str
    _checked: bool = False

    @property
    def name(self) -> str:
        """The hash that is the name of its file in the cache, without the suffix."""
        return self._stored.key

    @property
    def is_checked(self) -> bool:
        """True if this kernel, now or in an earlier process, agreed with the reference
        interpreter.
        """
        self._checked = self._checked or self._stored.is_checked(self._digest)
        return self._checked

    def mark_checked(self) -> None:
        """Stores in the cache that the kernel agreed with the reference interpreter."""
        self._checked = True
        self._stored.mark_checked(self._digest)


def compiled_kernel(source: str, *, on_lanes: bool = False, briefly: bool = False) -> Built:
    """Loads the kernel of a C source from the cache, or compiles it and stores it there. `on_lanes`
    selects the compiler flags for functions on SIMD vectors, `briefly` fast compilation (-O0) for
    code that is called some hundred times. The cache is the first trusted folder with room. Raises
    CompilerMissingError and KernelBuildError.
    """
    compiler = find_compiler()
    command = (*compiler, *kernel_flags(compiler, on_lanes=on_lanes, briefly=briefly))
    # `-march=native` depends on the processor, and caches may be on shared disks
    described = "\n".join((source, *command, _version(compiler), _processor()))
    key = hashlib.sha256(described.encode()).hexdigest()[:32]

    def build(library: Path, folder: Path) -> None:
        _compile(compiler, command, source, library, folder)

    for folder in candidates():
        with suppress(OSError):  # full, not writable, or not executable
            real, reason = opened(folder)
            if reason is None:
                return _loaded(StoredKernel(real, key), build)
    try:
        # a loaded library stays in memory without its file; Windows keeps the file
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
    """The flags for building kernels with this compiler command. `on_lanes` selects those for
    functions on SIMD vectors, `briefly` -O0. Raises CompilerMissingError if the compiler does not
    answer to `--version` in time.
    """
    if briefly:
        return (*BRIEF, *FLAGS)
    # gcc has many names, and other compilers use its name, but not its copyright
    is_gcc = "Free Software Foundation" in _told(compiler, installed_as(compiler))
    return (*(LANES_BY_GCC if on_lanes and is_gcc else FAST), *FLAGS)


def _loaded(stored: StoredKernel, build: Callable[[Path, Path], None]) -> Built:
    digest = stored.whole() or stored.built(build)
    return Built(stored.load(), stored, digest)


def _compile(
    compiler: tuple[str, ...], command: tuple[str, ...], source: str, library: Path, folder: Path
) -> None:
    """Compiles a source to the file `library`. `folder` may be used for temporary files. Raises
    KernelBuildError for a rejected source, CompilerMissingError if the compiler fails on every
    source or is too slow, OSError for a full folder.
    """

    def run(text: str) -> Finished:
        reading = ["-o", str(library), "-x", "c", "-", "-lm"]
        return _ended(compiler, [*command, *reading], text, folder)

    done = run(source)
    if done.code == 0:
        return
    has_room(folder)
    # a compiler that fails on any source is the user's problem; on this source only, it is our bug
    said = complaints(done.errors) or [f"it ended with code {done.code}"]
    if run("int answer(void) { return 42; }\n").code != 0:
        raise CompilerMissingError(f"`{shlex.join(compiler)}` compiles nothing ({said[0]})")
    raise KernelBuildError("\n".join(said[:_MOST_SAID]))


def _version(compiler: tuple[str, ...]) -> str:
    return _told(compiler, installed_as(compiler)).partition("\n")[0]


@cache
def _told(compiler: tuple[str, ...], file: tuple[int, ...]) -> str:
    """The output of `--version` of a compiler, cached while its executable does not change. `file`
    identifies the executable.
    """
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
    """Text that identifies the model and instruction sets of the processor, which `-march=native`
    depends on.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    wanted = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


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
    """The compiler with which kernels are built on this machine (`compiler` is name and version),
    its flags, and the processor features that it uses.
    """

    compiler: str
    command: str
    flags: tuple[str, ...]
    features: tuple[str, ...]

    @property
    def fuses(self) -> bool:
        """True if the processor computes a·b + c with one rounding, so that kernels give the same
        bits as on other such processors.
        """
        return not _FUSE.isdisjoint(self.features)


def kernel_description() -> KernelDescription | None:
    """The compiler and processor features of kernels on this machine; None without a working
    compiler.
    """
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
    """The predefined macros of the compiler with the flags of kernels, as `#define` lines, cached
    while its executable does not change. `file` identifies the executable. Raises
    CompilerMissingError, CompilerTooSlowError and OSError.
    """
    del file
    command = [*compiler, *kernel_flags(compiler, on_lanes=True), "-dM", "-E", "-x", "c", "-"]
    told = run_compiler(command, longest=_SECONDS)
    if told.code != 0:
        raise CompilerMissingError(f"`{shlex.join(compiler)}` says nothing of itself")
    return told.output
