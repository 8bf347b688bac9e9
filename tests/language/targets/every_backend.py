"""Runs a spec's step in every backend and compares each with the interpreter in float64."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.program import Program
from tests.every_op.run_c import DOUBLE, SINGLE, run_c
from tests.every_op.runners import Log, run_casadi, run_interpreter, run_onnx, run_torch
from tests.language.compiled import compiled


def assert_backends_agree(text: str, log: Mapping[str, ArrayLike], times: list[int]) -> None:
    """Outputs and next states of one step at each row, in torch, CasADi, ONNX and C."""
    assert_backends_agree_on(compiled(text), log, times)


def assert_backends_agree_on(
    program: Program, log: Mapping[str, ArrayLike], times: list[int]
) -> None:
    """The same for a program."""
    import torch

    program = _with_varied_weights(program)
    rows = np.array(times)
    series = {name: np.asarray(values, dtype=float) for name, values in log.items()}
    judge = run_interpreter(np.float64)(program, series, rows)
    runners = {
        "torch": run_torch(torch.float64),
        "casadi": run_casadi,
        "onnx": run_onnx(np.float64),
        "c": run_c(DOUBLE),
    }
    assert_same_bits_in_c(program, series, rows)
    for backend, run in runners.items():
        found = run(program, series, rows)
        for name, expected in (judge.outputs | judge.next_states).items():
            value = (found.outputs | found.next_states)[name]
            scale = max(1.0, float(np.max(np.abs(expected))))
            # the limit of one step in double precision that every backend promises
            np.testing.assert_allclose(
                value, expected, rtol=0, atol=1e-12 * scale, err_msg=f"{backend}: {name}"
            )


def assert_same_bits_in_c(program: Program, log: Log, rows: NDArray[np.int64]) -> None:
    """C in single precision has the bits of the interpreter in single precision."""
    judge = run_interpreter(np.float32)(program, log, rows)
    found = run_c(SINGLE)(program, log, rows)
    for name, expected in (judge.outputs | judge.next_states).items():
        value = (found.outputs | found.next_states)[name]
        np.testing.assert_array_equal(value, expected, err_msg=f"single: {name}")


def _with_varied_weights(program: Program) -> Program:
    """Initial values that are neither 0 nor equal, still inside the bounds that layers set."""
    generator = np.random.default_rng(0)
    return replace(
        program,
        parameters=tuple(
            replace(
                parameter,
                initial=tuple(value + generator.uniform(-0.4, 0.4) for value in parameter.initial),
            )
            for parameter in program.parameters
        ),
    )
