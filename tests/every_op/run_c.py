"""Runs one step of a program in C at many rows of a log, built once a program and precision."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c import COptions
from backends.c.host.build import build_library
from backends.c.host.library import CStep
from backends.c.interface.interface import c_interface
from backends.ports.step_interface import Port, step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import write_library
from tests.conditions import require_tool
from tests.every_op.runners import Log, Result, Runner, together

SINGLE, DOUBLE = COptions(dtype="float32", prefix="op"), COptions(dtype="float64", prefix="op")


def run_c(options: COptions) -> Runner:
    def run(program: Program, log: Log, times: NDArray[np.int64]) -> Result:
        program = to_step_form(program)
        interface = c_interface(program, options)
        inputs = step_interface(program).inputs
        windows = [port for _, port in interface.windows]
        supplied = [state.name for _, state in interface.supplied]
        judge = Interpreter(program, dtype=options.dtype)
        step = _built(program, options)
        results: list[Result] = []
        for t in times.tolist():
            step.init()
            if windows or supplied:
                # a start that reads the future cannot be computed on a target: it is given
                first = judge.start(log, t)
                states = {name: first[name][0] for name in supplied}
                step.reset({**states, **_values(windows, log, t)})
            outputs, _ = step.step(_values(inputs, log, t))
            results.append(Result(outputs, step.states()))
        return together(results)

    return run


@functools.cache
def _built(program: Program, options: COptions) -> CStep:
    compiler = require_tool("gcc", install="apt install gcc")
    with tempfile.TemporaryDirectory(prefix="every_op_") as name:
        folder = Path(name)
        write_library(program, folder, options)
        library = build_library(folder, folder / "op.so", [compiler], ["-O1"])
        return CStep.of_folder(
            folder, library
        )  # once it is loaded the library's file is not needed


def _values(ports: Iterable[Port], log: Log, t: int) -> Mapping[str, NDArray[Any]]:
    values: dict[str, NDArray[Any]] = {}
    for port in ports:
        rows = log[port.signal.name][t + port.first : t + port.last + 1]
        values[port.signal.name] = np.moveaxis(rows, 0, -1).reshape(port.type.shape)
    return values
