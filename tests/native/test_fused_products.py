"""Which products of an expression are rounded together with the sum they are added to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import pytest

from backends.c_kernels.routine import operands
from backends.c_language.tree import (
    Binary,
    CType,
    Declare,
    Element,
    Expression,
    Function,
    Name,
    Unary,
    Unsigned,
)
from backends.native.lane_kernels import LanePrinter, lane_kernels, with_fused_products
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import DOUBLE
from compiler.kernels.trace import statements as kernel
from compiler.kernels.trace.statements import Assign, Block, Branch, Local, Operator, ValueKind
from compiler.kernels.trace.values import trace

A, B, C, D, E = map(Name, "abcde")


def times(left: Expression, right: Expression) -> Binary:
    return Binary("*", left, right)


def plus(left: Expression, right: Expression) -> Binary:
    return Binary("+", left, right)


def minus(left: Expression, right: Expression) -> Binary:
    return Binary("-", left, right)


CASES: list[tuple[Expression, str]] = [
    (plus(A, times(B, C)), "fused(b, c, a)"),
    (plus(times(B, C), A), "fused(b, c, a)"),
    (minus(A, times(B, C)), "fused(-b, c, a)"),
    (minus(times(B, C), A), "fused(b, c, -a)"),
    (plus(A, Unary("-", times(B, C))), "fused(-b, c, a)"),
    (minus(A, Unary("-", times(B, C))), "fused(b, c, a)"),
    (plus(times(A, B), times(C, D)), "fused(c, d, a * b)"),
    (plus(plus(times(A, B), times(C, D)), E), "fused(c, d, a * b) + e"),
    (times(plus(A, times(B, C)), D), "fused(b, c, a) * d"),
    (plus(A, Binary("/", times(B, C), D)), "a + ((b * c) / d)"),
    (Element(A, plus(times(B, Unsigned(4)), Unsigned(1))), "a[(b * 4U) + 1U]"),
]


@pytest.mark.parametrize(("expression", "text"), CASES)
def test_a_product_in_a_sum_is_fused(expression: Expression, text: str) -> None:
    function = Function(
        name="f", result="void", arguments=(), body=(Declare(CType.REAL, "x", expression),)
    )
    printed = LanePrinter("msnn", "float64").function(with_fused_products(function))
    assert f"lanes x = {text};" in printed


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_a_sum_of_a_kernel_takes_a_product_that_nothing_else_reads(name: str) -> None:
    """A product that is read twice has to be rounded: the exact errors of `double_word` need it."""
    routine = trace(KERNELS[name].subroutine, DOUBLE)
    uses = Counter(operands(routine.body))
    reals = dict(_real_operations(routine.body))
    products = {
        local
        for local, operation in reals.items()
        if operation.operator is Operator.MULTIPLY and uses[local] == 1
    }
    sums = [each for each in reals.values() if each.operator in (Operator.ADD, Operator.SUBTRACT)]
    taking = [each for each in sums if {each.left, each.right} & products]
    text = lane_kernels([name], DOUBLE, "msnn").rpartition("static lanes")[2]
    assert text.count("fused(") == len(taking)


def _real_operations(block: Block) -> Iterator[tuple[Local, kernel.Binary]]:
    for statement in block.statements:
        match statement:
            case Assign(target, kernel.Binary() as operation) if target.kind is ValueKind.REAL:
                yield target, operation
            case Branch(_, _, then, otherwise):
                yield from _real_operations(then)
                yield from _real_operations(otherwise)
            case _:
                pass
