"""Every operation and every scalar function in every backend against plain numpy."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
import torch

from compiler.ops import Op, Relation
from compiler.scalar_functions import SCALAR_FUNCTIONS
from tests.every_op.agreement import assert_agrees
from tests.every_op.record import Record
from tests.every_op.records import FUNCTION_RECORDS, OP_RECORDS, RECORDS
from tests.every_op.runners import (
    Runner,
    run_casadi,
    run_interpreter,
    run_onnx,
    run_torch,
)

DOUBLE = 1e-12
"""The project's promise for one step in float64: a few thousand roundings of 1.1e-16."""

SINGLE = 1e-5
"""The promise for one step in float32: a hundred roundings of 6e-8."""

BACKENDS: dict[str, tuple[Runner, float]] = {
    "interpreter64": (run_interpreter(np.float64), DOUBLE),
    "interpreter32": (run_interpreter(np.float32), SINGLE),
    "torch64": (run_torch(torch.float64), DOUBLE),
    "torch32": (run_torch(torch.float32), SINGLE),
    "casadi": (run_casadi, DOUBLE),
    "onnx64": (run_onnx(np.float64), DOUBLE),
    "onnx32": (run_onnx(np.float32), SINGLE),
}


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
@pytest.mark.parametrize("backend", BACKENDS)
def test_backend_agrees_with_numpy(record: Record, backend: str):
    run, tolerance = BACKENDS[backend]
    result = run(record.program, record.log, record.times)
    assert set(result.outputs) == set(record.expected)
    for name, expected in record.expected.items():
        assert_agrees(result.outputs[name], expected, tolerance, f"{record.name} {name}")
    for name, expected in record.expected_next.items():
        assert_agrees(result.next_states[name], expected, tolerance, f"{record.name} next {name}")


def test_every_operation_has_a_record():
    named = {name.rstrip("<>=") for name in OP_RECORDS} | {"Apply"}
    assert {op.__name__ for op in get_args(Op)} == named


def test_every_relation_has_a_record():
    assert {f"Compare{relation.value}" for relation in Relation} <= set(OP_RECORDS)


@pytest.mark.parametrize("name", OP_RECORDS)
def test_a_record_has_its_operation(name: str):
    program = OP_RECORDS[name].program
    ops = {
        type(node.op).__name__ for graph in (program.step, program.start) for node in graph.nodes
    }
    assert name.rstrip("<>=") in ops


def test_every_scalar_function_has_a_record():
    assert set(FUNCTION_RECORDS) == set(SCALAR_FUNCTIONS)
