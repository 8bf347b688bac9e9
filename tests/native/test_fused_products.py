"""Which products of an expression are rounded together with the sum they are added to."""

from __future__ import annotations

import re

import pytest

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
from backends.native.lanes.fused_kernels import fused_sums
from backends.native.lanes.fused_products import with_fused_products
from backends.native.lanes.lane_kernels import lane_kernels
from backends.native.lanes.lane_printer import LanePrinter
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import DOUBLE
from compiler.kernels.trace.subroutine import trace

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
    function = Function("f", "void", (), (Declare(CType.REAL, "x", expression),))
    printed = LanePrinter("msnn", "float64").function(with_fused_products(function))
    assert f"lanes x = {text};" in printed


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_every_product_of_a_kernel_is_written_once(name: str) -> None:
    """Where it is assigned or where it is fused: what a sum has taken stands nowhere else."""
    routine = trace(KERNELS[name].subroutine, DOUBLE)
    fused = fused_sums(routine)
    text = lane_kernels([name], DOUBLE, "msnn").rpartition("static ")[2]
    assert len(fused.sums) == len(fused.products) == len(re.findall(r"= fused\(", text))
    for product in fused.products:
        assert re.search(rf"\bv{product}\b", text) is None
