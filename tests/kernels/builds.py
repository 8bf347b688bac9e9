"""Compiles the kernels' C text and calls it on arrays."""

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c_kernels.sources import c_sources
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import FORMATS, RealName

Array = NDArray[Any]

STRICT = (
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion"),
    *("-Wshadow", "-Wdouble-promotion", "-Wfloat-equal", "-Wundef", "-Wcast-qual"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-Wswitch-default", "-Wvla"),
    *("-Wfloat-conversion", "-Wredundant-decls", "-Wwrite-strings", "-Werror"),
    "-ffp-contract=off",
)


def write_sources(folder: Path, real: RealName, *, constant_time: bool = False) -> Path:
    """Writes header and source of all kernels; the path of the source."""
    sources = c_sources(KERNELS, real, "own", constant_time=constant_time)
    (folder / sources.header_name).write_text(sources.header, encoding="utf-8")
    (folder / sources.source_name).write_text(sources.source, encoding="utf-8")
    return folder / sources.source_name


def compile_loops(
    folder: Path,
    real: RealName,
    compiler: str,
    flags: tuple[str, ...],
    *,
    constant_time: bool = False,
) -> Callable[..., Array]:
    """call(name, *arrays): the compiled kernel on every element."""
    source = write_sources(folder, real, constant_time=constant_time)
    loops = folder / "loops.c"
    loops.write_text(_loops(real), encoding="utf-8")
    library = folder / "kernels.so"
    command = [compiler, *STRICT, *flags, "-fPIC", "-shared", str(source), str(loops)]
    subprocess.run([*command, "-o", str(library), "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))

    def call(name: str, *arrays: Array) -> Array:
        columns = [np.ascontiguousarray(array, dtype=FORMATS[real].dtype) for array in arrays]
        result = np.empty_like(columns[0])
        pointers = [column.ctypes.data_as(ctypes.c_void_p) for column in [*columns, result]]
        getattr(loaded, f"run_{name}")(*pointers, ctypes.c_size_t(result.size))
        return result

    return call


def _loops(real: RealName) -> str:
    text = ["#include <stddef.h>", '#include "own_math.h"']
    for name, kernel in KERNELS.items():
        inputs = [f"in_{parameter}" for parameter in kernel.parameters]
        declared = ", ".join(f"const {real} *{column}" for column in inputs)
        passed = ", ".join(f"{column}[i]" for column in inputs)
        signature = f"void run_{name}({declared}, {real} *out, size_t count)"
        loop = f"for (size_t i = 0U; i < count; i++) {{ out[i] = own_{name}({passed}); }}"
        text += [f"{signature};", f"{signature} {{ {loop} }}"]
    return "\n".join(text) + "\n"


def same_bits(one: Array, other: Array) -> Array:
    """Elementwise: equal bits, or both NaN (which NaN it is differs between processors)."""
    unsigned = f"u{one.dtype.itemsize}"
    return (one.view(unsigned) == other.view(unsigned)) | (np.isnan(one) & np.isnan(other))
