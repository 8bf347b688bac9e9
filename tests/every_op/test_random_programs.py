"""Random well-typed programs mean the same in all fast backends, slopes included."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from hypothesis import HealthCheck, given, settings
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.ir.verifier import verify
from tests.every_op.gradients import by_casadi, by_jacobian, by_torch, problem
from tests.every_op.random_programs import programs
from tests.every_op.runners import Runner, run_casadi, run_onnx, run_torch

RANDOM = np.random.default_rng(11)
LOG = {"u": RANDOM.uniform(-1.5, 1.5, 12), "q": RANDOM.uniform(-1.5, 1.5, (12, 3))}
TIMES = np.arange(4, 9)

VALUES = 1e-12
"""Of the largest value in the program: what cancels below that is no fault of a backend."""

SLOPES = 1e-10
"""Both are exact derivatives; chains of two dozen operations amplify their rounding more."""

RUNNERS: dict[str, Runner] = {
    "torch": run_torch(torch.float64),
    "casadi": run_casadi,
    "onnx": run_onnx(np.float64),
}


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(programs())
def test_backends_agree(program: Program):
    verify(program)
    judge = Interpreter(program)
    expected = judge.step(LOG, TIMES, judge.start(LOG, TIMES))
    finite = [value for value in expected.nodes if value is not None and _is_finite(value)]
    largest = max(np.abs(value).max() for value in finite)
    for name, run in RUNNERS.items():
        result = run(program, LOG, TIMES)
        _assert_close(result.outputs, expected.outputs, VALUES * largest, name)
        _assert_close({"x": result.next_states["x"]}, expected.next_states, VALUES * largest, name)


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(programs())
def test_slopes_agree(program: Program):
    p = problem(program, LOG, TIMES)
    expected = by_torch(p)
    largest = max(1.0, *(np.abs(slope).max() for slope in expected.values()))
    _assert_close(by_casadi(p), expected, SLOPES * largest, "casadi")
    _assert_close(by_jacobian(p), expected, SLOPES * largest, "jacobian")


def _is_finite(value: NDArray[Any]) -> bool:
    return value.dtype != bool and bool(np.isfinite(value).all())


def _assert_close(
    found: Mapping[Any, NDArray[Any]],
    expected: Mapping[Any, NDArray[Any]],
    allowed: float,
    backend: str,
) -> None:
    for key, value in expected.items():
        assert np.isfinite(value).all(), f"the program gives {key} = {value}"
        np.testing.assert_allclose(found[key], value, rtol=0, atol=allowed, err_msg=backend)
