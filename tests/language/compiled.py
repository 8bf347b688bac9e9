"""Compiles a spec given as text and runs it on a log, for tests of the language's rules."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import dedent

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.elaboration.compile import compile_spec
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import read_spec

Array = NDArray[np.float64]


def compiled(text: str) -> Program:
    """The program of a spec; `msnn: 1`, a name and a sample time of 0.1 s need not be written."""
    body = dedent(text)
    head = "msnn: 1\nname: test\n" + ("" if "sample_time" in body else "sample_time: 0.1 s\n")
    return compile_spec(read_spec("test.yaml", head + body).spec).program


def warnings_of(text: str) -> list[str]:
    """Codes of the warnings of a spec."""
    body = dedent(text)
    head = "msnn: 1\nname: test\n" + ("" if "sample_time" in body else "sample_time: 0.1 s\n")
    found = compile_spec(read_spec("test.yaml", head + body).spec).warnings
    return [diagnostic.code for diagnostic in found]


def codes(text: str) -> list[str]:
    """Codes of the errors that reading and compiling the spec raises."""
    try:
        compiled(text)
    except SpecError as error:
        return [d.code for d in error.diagnostics if d.severity == "error"]
    return []


def evaluated(
    text: str,
    log: Mapping[str, ArrayLike],
    t: int = 0,
    weights: Mapping[str, ArrayLike] | None = None,
    output: str = "y",
) -> Array:
    """The value of an output at row t of the log."""
    program = compiled(text)
    interpreter = Interpreter(program, weights)
    series = {name: np.asarray(values, dtype=float) for name, values in log.items()}
    rows = np.array([t])
    step = interpreter.step(series, rows, interpreter.start(series, rows))
    return step.outputs[output][0]


def simulated(
    text: str,
    log: Mapping[str, ArrayLike],
    t0: int,
    steps: int,
    weights: Mapping[str, ArrayLike] | None = None,
    output: str = "y",
) -> Array:
    """An output over a run of the states that starts at row t0."""
    interpreter = Interpreter(compiled(text), weights)
    series = {name: np.asarray(values, dtype=float) for name, values in log.items()}
    return interpreter.rollout(series, np.array([t0]), steps).outputs[output][0]
