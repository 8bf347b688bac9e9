"""Finds the uses of operands in a traced routine, which determine how C writes them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from compiler.kernels.trace import statements as traced


def operands(block: traced.Block) -> Iterator[traced.Operand]:
    """Every use of an operand in a block and its inner blocks."""
    # results are uses too: otherwise the last statement would look unused
    yield from block.values
    for statement in block.statements:
        match statement:
            case traced.Assign(_, operation):
                yield from traced.operation_operands(operation)
            case traced.Call(_, _, arguments):
                yield from arguments
            case traced.Branch(_, condition, then, otherwise):
                yield condition
                yield from operands(then)
                yield from operands(otherwise)
            case _:
                assert_never(statement)


def branch_values(block: traced.Block) -> Iterator[traced.Operand]:
    """The results of branch arms, which are assigned as a whole."""
    for statement in block.statements:
        if isinstance(statement, traced.Branch):
            for arm in (statement.then, statement.otherwise):
                yield from arm.values
                yield from branch_values(arm)


def plain_operands(block: traced.Block) -> Iterator[traced.Operand]:
    """The operands of casts and selections, which must be plain or negated variables."""
    for statement in block.statements:
        match statement:
            case traced.Assign(_, traced.Convert(operand)):
                yield operand
            case traced.Assign(_, traced.Select(_, then, otherwise)):
                yield then
                yield otherwise
            case traced.Branch(_, _, then, otherwise):
                yield from plain_operands(then)
                yield from plain_operands(otherwise)
            case _:
                pass
