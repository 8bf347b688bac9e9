"""Builds a kernel once: source, flags, compiler and processor decide the file it is kept in."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

from backends.files.atomic_write import replacing
from backends.files.c_compiler import CompilerMissingError, find_compiler

FLAGS = (
    "-std=gnu11",
    "-O3",
    "-funroll-loops",
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
`fused` where one rounding is enough (lanes/fused_products.py)."""


class KernelBuildError(Exception):
    """The compiler refused a kernel: a bug of the emitter, with the compiler's own words."""


def cache_folder() -> Path:
    """Where kernels are kept: MSNN_CACHE, else the user's cache folder."""
    given = os.environ.get("MSNN_CACHE")
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "msnn" / "kernels"


@dataclass(slots=True)
class Built:
    """A loaded kernel and the file that says it was found right."""

    library: ctypes.CDLL
    seal: Path
    _checked: bool = False

    @property
    def is_checked(self) -> bool:
        """Whether somebody compared this kernel with the interpreter."""
        self._checked = self._checked or self.seal.exists()
        return self._checked

    def mark_checked(self) -> None:
        """Remembers that the comparison went well."""
        self.seal.touch()


def compiled_kernel(source: str) -> Built:
    """The loaded kernel of a source, compiled if it was not yet.

    Raises CompilerMissingError and KernelBuildError. Several processes may ask for one kernel at
    once: each builds its own file and the rename is atomic.
    """
    compiler = find_compiler()
    described = "\n".join((source, *FLAGS, *compiler, _version(compiler), _processor()))
    key = hashlib.sha256(described.encode()).hexdigest()[:32]
    path = cache_folder() / f"{key}.so"
    if not path.exists():
        _compile(compiler, source, path)
    return Built(ctypes.CDLL(str(path)), path.with_suffix(".checked"))


def _compile(compiler: tuple[str, ...], source: str, path: Path) -> None:
    with replacing(path) as temporary:
        done = _run(compiler, source, temporary)
        if done.returncode == 0:
            return
        tried = _run(compiler, "int answer(void) { return 42; }\n", temporary)
        if tried.returncode != 0:
            raise CompilerMissingError(f"`{shlex.join(compiler)}` compiles nothing")
        raise KernelBuildError(done.stderr[-2000:] or f"it ended with code {done.returncode}")


def _run(compiler: tuple[str, ...], source: str, library: Path) -> subprocess.CompletedProcess[str]:
    command = [*compiler, *FLAGS, "-o", str(library), "-x", "c", "-", "-lm"]
    # a session of its own: Ctrl-C is for the training, which ends once there is a kernel
    return subprocess.run(
        command, input=source, capture_output=True, text=True, check=False, start_new_session=True
    )


def _version(compiler: tuple[str, ...]) -> str:
    """What the compiler says of itself."""
    told = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False)
    return told.stdout.partition("\n")[0]


def _processor() -> str:
    """What -march=native depends on: the model and features of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    wanted = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
