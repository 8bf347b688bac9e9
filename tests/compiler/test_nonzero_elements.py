"""Elements that a formula makes 0, and those that only happen to be 0."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.types import Axis, Type
from compiler.jacobian.zeros import nonzero_elements
from tests.every_op.record import Record
from tests.every_op.records import RECORDS

ROWS, COLUMNS = Axis("i", 3), Axis("j", 2)
Formula = Callable[[GraphBuilder, NodeId, NodeId], NodeId]


def _where(b: GraphBuilder, x: NodeId, mask: NodeId) -> NodeId:
    zero = b.constant([0.0, 0.0, 0.0], (ROWS,))
    return b.select(b.compare(Relation.LESS, x, mask), mask, zero)


CASES: dict[str, tuple[Formula, list[int]]] = {
    "a value that is read": (lambda b, x, m: x, [1, 1, 1]),
    "a constant": (lambda b, x, m: m, [0, 1, 0]),
    "a product": (lambda b, x, m: b.multiply(x, m), [0, 1, 0]),
    "a quotient": (lambda b, x, m: b.divide(m, x), [0, 1, 0]),
    "a sum of zeros": (lambda b, x, m: b.subtract(b.negate(m), b.multiply(m, x)), [0, 1, 0]),
    "a sum with what is read": (lambda b, x, m: b.add(m, x), [1, 1, 1]),
    "a difference that cancels": (lambda b, x, m: b.subtract(m, m), [0, 1, 0]),
    "a function of zero": (lambda b, x, m: b.apply("cos", m), [1, 1, 1]),
    "both branches": (_where, [0, 1, 0]),
    "an element": (lambda b, x, m: b.element(m, "i", 0), [0]),
    "elements in a row": (lambda b, x, m: b.concat([m, x], "i"), [0, 1, 0, 1, 1, 1]),
    "repeated": (lambda b, x, m: b.broadcast(m, (COLUMNS, ROWS)), [0, 1, 0, 0, 1, 0]),
    "all added up": (lambda b, x, m: b.sum(m, "i"), [1]),
    "a product of vectors": (lambda b, x, m: b.contract(m, x), [1]),
    "a product of vectors apart": (
        lambda b, x, m: b.contract(b.constant([1.0, 0.0, 1.0], (ROWS,)), b.multiply(m, x)),
        [0],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_zeros_pass_through_formulas(name: str) -> None:
    formula, expected = CASES[name]
    b = GraphBuilder()
    x = b.parameter("x", Type((ROWS,)))
    node = formula(b, x, b.constant([0.0, 2.0, 0.0], (ROWS,)))
    found = nonzero_elements(b.graph(), [node])[node]
    assert found.shape == b.type(node).shape
    np.testing.assert_array_equal(found.ravel(), np.array(expected, dtype=bool))


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_every_operation_has_marks_of_its_shape(record: Record) -> None:
    step = record.program.step
    values = [index for index, _ in step]
    for index, marks in nonzero_elements(step, values).items():
        assert marks.shape == step[index].type.shape
