"""The base classes of operations group the closed set, and nothing is outside it."""

from __future__ import annotations

from typing import get_args

import pytest

from compiler.ir import ops
from tests.every_op.records import OP_RECORDS

GROUPS = (ops.Leaf, ops.Elementwise, ops.Structure, ops.Reduction, ops.Window)
UNION: tuple[type, ...] = get_args(ops.Op)


def test_every_operation_is_of_one_group():
    for op in UNION:
        assert sum(issubclass(op, group) for group in GROUPS) == 1, op


def test_every_class_of_a_group_is_in_the_union_or_a_base_of_some():
    """A class outside it would get past every `match` without a word of pyright."""
    declared = [c for c in vars(ops).values() if isinstance(c, type) and issubclass(c, GROUPS)]
    bases = {base for op in UNION for base in op.__mro__[1:]}
    assert {c for c in declared if c not in bases} == set(UNION)


@pytest.mark.parametrize("name", OP_RECORDS)
def test_operands_are_as_many_and_as_shaped_as_the_group_says(name: str):
    program = OP_RECORDS[name].program
    op = name.rstrip("<>=")
    for graph in (program.step, program.start):
        for _, node in graph:
            if type(node.op).__name__ == op:
                assert node.op.arity in (None, len(node.args))
                if isinstance(node.op, ops.Elementwise):
                    assert all(graph[arg].type.axes == node.type.axes for arg in node.args)
