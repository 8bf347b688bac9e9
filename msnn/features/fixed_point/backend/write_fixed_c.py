"""Writes a folder of C in fixed point, and measures its errors over a million steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c.folder.file_texts import model_texts
from backends.c.host.build import CompilerFailedError, build_library
from backends.c.host.library import CStep
from backends.c.interface.interface import c_interface
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_text
from backends.files.c_compiler import CompilerMissingError
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.features.fixed_point.backend.file_texts import file_texts, step_texts
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.compile.word_formats import finite
from msnn.features.fixed_point.deviation import (
    HELD,
    ErrorSpread,
    OutputError,
    output_errors,
    reference,
)
from msnn.features.fixed_point.golden.golden import drawn
from msnn.features.fixed_point.integers.program import WIDTHS, IntegerProgram, WordPort


@dataclass(frozen=True, slots=True)
class FixedExport:
    """The paths of the written files, and the measured errors of each output against float64."""

    files: tuple[Path, ...]
    errors: tuple[OutputError, ...]


def write_fixed_c(
    program: Program, weights: Mapping[str, ArrayLike], folder: Path, prefix: str, dtype: str
) -> FixedExport:
    """Writes header, sources, self-test, build file and README of C in fixed point to `folder`.

    `program` is in step form; `weights` are physical values by name, `dtype` is `q15` or `q31`. The
    same arguments give the same bytes. Raises SpecError for values that fixed point cannot
    represent, and OSError.
    """
    numbers: dict[str, Any] = physical_weights(program, weights)
    integers = integer_program(program, numbers, WIDTHS[dtype])
    with np.errstate(all="ignore"):
        errors = measured_errors(program, numbers, integers)
    texts = file_texts(integers, prefix, errors)
    files = tuple(write_text(folder / name, text) for name, text in texts.items())
    return FixedExport(files, errors)


STEPS = 1_000_000
_RUNS, _SEED = 8, 12
_PREFIX = "measured"

Array = NDArray[Any]


def measured_errors(
    program: Program, weights: Mapping[str, Array], integers: IntegerProgram
) -> tuple[OutputError, ...]:
    """The errors of each output against float64, over closed-loop runs from random pasts with
    inputs drawn from their full range.

    Half of the runs hold their inputs for several steps, so that errors can accumulate. Without a C
    compiler, or if a start reads future samples, the interpreters run fewer steps.
    """
    exact = reference(program)
    # float64, as the judge has it: what is measured is rounding to words, and a float32 reference
    # would add its own
    interface = c_interface(exact, COptions(dtype="float64", prefix=_PREFIX))
    if interface.supplied:
        # the C of `reals` would ask its caller for fitted starts or future samples, which nobody
        # has here
        return output_errors(program, weights, integers)
    # Windows does not remove a library that is loaded
    with TemporaryDirectory(prefix="msnn_", ignore_cleanup_errors=True) as place:
        try:
            words = _built(step_texts(integers, _PREFIX), Path(place) / "words")
            reals = _built(model_texts(exact, interface, weights), Path(place) / "reals")
        except (CompilerMissingError, CompilerFailedError):
            return output_errors(program, weights, integers)
        return _Comparison(program, integers, words, reals).errors()


def _built(texts: Mapping[str, str], folder: Path) -> CStep:
    for name, text in texts.items():
        # the loop over steps is built with the code: a call from Python takes longer than a step
        write_text(folder / (f"src/{name}" if name.endswith("_ffi.c") else name), text)
    return CStep.of_folder(folder, build_library(folder, folder / "step.so"))


@dataclass(frozen=True, slots=True)
class _Comparison:
    program: Program
    integers: IntegerProgram
    words: CStep
    reals: CStep

    def errors(self) -> tuple[OutputError, ...]:
        """The errors of every output, over all runs."""
        spreads = {output.name: ErrorSpread(name=output.name) for output in self.program.outputs}
        ports = {port.name: port for port, _ in self.integers.outputs}
        inputs = {entry.port.name: entry.port for entry in self.integers.inputs}
        # Philox counts: the draws of a seed are the same on every machine and with every version of
        # numpy
        random = np.random.Generator(np.random.Philox(_SEED))
        count = STEPS // _RUNS
        for run in range(_RUNS):
            self._reset({port.name: drawn(port, random) for port in self.integers.windows})
            given = self._inputs(count, random, held=run % 2 == 1)
            # both get the values of words: rounding an input is the caller's error
            found, _ = self.words.run(given, count)
            real = {name: _real(port, given[name]) for name, port in inputs.items()}
            exact, _ = self.reals.run(self._with_needless(real, count), count)
            for name, spread in spreads.items():
                spread.add(exact[name], _real(ports[name], found[name]))
        return tuple(spread.error(self.program) for spread in spreads.values())

    def _reset(self, windows: Mapping[str, list[int]]) -> None:
        """Starts both programs from the same samples around the first step; `windows` are flat
        words by port.
        """
        ports = {port.name: port for port in self.integers.windows}
        shapes = self.words.start_shapes
        self.words.reset({name: np.reshape(windows[name], shapes[name]) for name in ports})
        found: dict[str, Array] = {}
        for name, shape in self.reals.start_shapes.items():
            port = ports.get(name)
            # a window that fixed point left out has no influence, so any value in its range will do
            low = self._low_end(name)
            values = np.full(shape, low) if port is None else _real(port, np.array(windows[name]))
            found[name] = values.reshape(shape)
        self.reals.reset(found)

    def _with_needless(self, given: dict[str, Array], count: int) -> dict[str, Array]:
        """The inputs of the float64 program; inputs that fixed point omits are constant."""
        return {
            name: given[name] if name in given else np.full((count, *shape), self._low_end(name))
            for name, shape in self.reals.input_shapes.items()
        }

    def _low_end(self, name: str) -> float:
        """The lower limit of the range of a signal; 0 without a range."""
        signal = next(s for s in self.program.signals if s.name == name)
        return (finite(signal.range) or (0.0, 0.0))[0]

    def _inputs(self, count: int, random: np.random.Generator, *, held: bool) -> dict[str, Array]:
        """Random words for `count` steps by input, (count, *shape). If `held`, they change only
        every `HELD` steps.
        """
        drawings = math.ceil(count / HELD) if held else count
        found: dict[str, Array] = {}
        for entry in self.integers.inputs:
            port = entry.port
            shape = tuple(axis.size for axis in port.axes)
            words = random.integers(port.low, port.high, (drawings, *shape), endpoint=True)
            found[port.name] = np.repeat(words, HELD, axis=0)[:count] if held else words
        return found


def _real(port: WordPort, words: Array) -> NDArray[np.float64]:
    return np.ldexp(words.astype(np.float64), -port.fraction)
