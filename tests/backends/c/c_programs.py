"""Sample programs in step form, and builds of their C, for the tests of the C backend."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c import COptions
from backends.c.folder.file_texts import library_texts
from backends.c.host.build import build_library
from backends.c.host.library import CStep
from backends.c.interface.interface import c_interface
from backends.c.selftest.golden_vectors import GoldenRun, GoldenVectors, golden_runs
from backends.files.atomic_write import write_text
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from tests.conditions import require_tool
from tests.programs import SAMPLES


def closed_sample(name: str) -> Program:
    """A sample program with its loops closed, in step form."""
    sample = SAMPLES[name]()
    return to_step_form(close_loop(sample.program, sample.closed))


def built(
    program: Program,
    folder: Path,
    options: COptions,
    compiler: Sequence[str] | None = None,
    flags: Sequence[str] = ("-O0",),
    weights: Mapping[str, ArrayLike] | None = None,
) -> CStep:
    """The program's C with its self-test, written into the folder, compiled and loaded.

    Its bits are those of every level (`test_bits.py`; with all options `test_strictness.py`).
    """
    write_library(program, folder, options, weights)
    library = folder / f"lib{len(list(folder.glob('*.so')))}.so"
    return CStep.of_folder(folder, build_library(folder, library, compiler, flags))


def write_library(
    program: Program,
    folder: Path,
    options: COptions,
    weights: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Writes what a target compiles.

    `write_c` adds a test program: to search its steps takes longer than what most tests look at.
    """
    interface = c_interface(program, options)
    texts = library_texts(program, interface, physical_weights(program, weights or {}))
    for name, text in texts.items():
        write_text(folder / name, text)


def program_said(folder: Path) -> str:
    """What the test program says that `write_c` wrote."""
    compiler = require_tool("gcc", install="apt install gcc")
    sources = [str(path) for part in ("src", "test") for path in (folder / part).glob("*.c")]
    binary = str(folder / "binary")
    flags = ["-std=c99", "-O1", "-ffp-contract=off", f"-I{folder / 'include'}"]
    subprocess.run([compiler, *flags, *sources, "-o", binary, "-lm"], check=True)
    return subprocess.run([binary], check=False, capture_output=True, text=True).stdout


def golden(program: Program, options: COptions, steps: int, seed: int) -> GoldenVectors:
    interface = c_interface(program, options)
    weights = physical_weights(program, {})
    (run,) = golden_runs(program, interface, weights, steps, [GoldenRun(seed)])
    return run


def replay(step: CStep, vectors: GoldenVectors) -> tuple[dict[str, NDArray[Any]], NDArray[Any]]:
    """What the C answers to golden vectors."""
    step.reset({**vectors.start.windows, **vectors.start.supplied})
    return step.run(vectors.inputs, len(vectors.status))


def assert_same_bits(
    found: Mapping[str, NDArray[Any]], expected: Mapping[str, NDArray[Any]]
) -> None:
    """Every number has the same bits, -0 is not 0; NaN is NaN whatever its payload."""
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name].dtype == value.dtype
        assert found[name].shape == value.shape, name
        nan = np.isnan(value)
        assert np.array_equal(np.isnan(found[name]), nan), name
        bits = np.dtype(f"u{value.dtype.itemsize}")
        differing = (found[name].view(bits) != np.ascontiguousarray(value).view(bits)) & ~nan
        assert not differing.any(), f"{name}: {int(differing.sum())} numbers differ"
