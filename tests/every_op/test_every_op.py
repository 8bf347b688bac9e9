"""Every operation and every scalar function in every backend against plain numpy."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
import torch

from compiler.ir.ops import Op, Relation
from compiler.ir.scalars import SCALAR_FUNCTIONS
from tests.every_op.agreement import assert_agrees, assert_same_bits
from tests.every_op.record import Record
from tests.every_op.records import FUNCTION_RECORDS, OP_RECORDS, RECORDS
from tests.every_op.run_c import DOUBLE as C_DOUBLE
from tests.every_op.run_c import SINGLE as C_SINGLE
from tests.every_op.run_c import run_c
from tests.every_op.runners import Runner, run_casadi, run_interpreter, run_onnx, run_torch

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
    "c64": (run_c(C_DOUBLE), DOUBLE),
}
"""C in float32 has the bits of `interpreter32`, which is asked below."""


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


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_c_has_the_bits_of_the_float32_interpreter(record: Record):
    expected = run_interpreter(np.float32)(record.program, record.log, record.times)
    result = run_c(C_SINGLE)(record.program, record.log, record.times)
    assert set(result.outputs) == set(record.expected)
    for name in record.expected:
        assert_same_bits(result.outputs[name], expected.outputs[name], f"{record.name} {name}")
    for name in record.expected_next:
        found = result.next_states[name]
        assert_same_bits(found, expected.next_states[name], f"{record.name} next {name}")


def test_every_operation_has_a_record():
    named = {name.rstrip("<>=") for name in OP_RECORDS} | {"Apply"}
    # which only graphs of training have: tests/native compares those
    named.add("ReadTraining")
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
