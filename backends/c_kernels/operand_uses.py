"""Finds where the operands of a traced routine are used, which decides how C text writes them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from compiler.kernels.trace import statements as traced


def operands(block: traced.Block) -> Iterator[traced.Operand]:
    """Every use of an operand in a block and in those within it."""
    # results are uses too: without them the last statement would look unused
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
    """The values that arms of branches give: assigned as a whole, not part of an expression."""
    for statement in block.statements:
        if isinstance(statement, traced.Branch):
            for arm in (statement.then, statement.otherwise):
                yield from arm.values
                yield from branch_values(arm)


def plain_operands(block: traced.Block) -> Iterator[traced.Operand]:
    """The operands that are cast or chosen: plain or negated variables, never expressions."""
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
