"""Changes the constants of a math kernel to neighbouring numbers, one at a time, to test
the tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import assert_never

import numpy as np

from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Call,
    Constant,
    Convert,
    Lookup,
    Operand,
    Operation,
    Routine,
    Select,
    Statement,
    Table,
    Unary,
    ValueKind,
)

Site = tuple[str, int]
"""A routine or a table by its name, and which of its constants."""


def changed_constants(routine: Routine) -> Iterator[tuple[Site, Routine]]:
    """Yields the routine with one constant changed.

    A float becomes the next one above or below; the last bit of an integer changes. A constant of a
    called routine is changed in all of its calls.
    """
    sites: dict[Site, Constant] = {}

    def note(site: Site, constant: Constant) -> Constant:
        sites.setdefault(site, constant)
        return constant

    _Rewriting(note).routine(routine)
    for site, constant in sites.items():
        for other in _neighbours(constant, routine):
            yield site, _with(routine, site, other)


def _with(routine: Routine, site: Site, other: Constant) -> Routine:
    return _Rewriting(lambda here, constant: other if here == site else constant).routine(routine)


def _neighbours(constant: Constant, routine: Routine) -> Iterator[Constant]:
    if constant.kind is ValueKind.REAL:
        dtype = routine.format.dtype.type
        for limit in (-math.inf, math.inf):
            with np.errstate(over="ignore"):
                beside = float(np.nextafter(dtype(constant.value), dtype(limit)))
            if math.isfinite(beside):
                yield Constant(constant.kind, beside)
    elif constant.kind is not ValueKind.TRUTH:
        yield Constant(constant.kind, int(constant.value) ^ 1)


class _Rewriting:
    """Rebuilds a routine with each constant replaced by a function of it, in the order of
    the text.
    """

    def __init__(self, change: Callable[[Site, Constant], Constant]) -> None:
        self._change = change

    def routine(self, routine: Routine) -> Routine:
        count = iter(range(1_000_000))

        def operand(given: Operand) -> Operand:
            return (
                self._change((routine.name, next(count)), given)
                if isinstance(given, Constant)
                else given
            )

        return replace(routine, body=self._block(routine.body, operand))

    def _block(self, block: Block, operand: Callable[[Operand], Operand]) -> Block:
        statements = tuple(self._statement(s, operand) for s in block.statements)
        return Block(statements, tuple(map(operand, block.values)))

    def _statement(self, statement: Statement, operand: Callable[[Operand], Operand]) -> Statement:
        match statement:
            case Assign(target, operation):
                return Assign(target, self._operation(operation, operand))
            case Call(targets, called, arguments):
                return Call(targets, self.routine(called), tuple(map(operand, arguments)))
            case Branch(targets, condition, then, otherwise):
                first, second = self._block(then, operand), self._block(otherwise, operand)
                return Branch(targets, condition, first, second)
            case _:
                assert_never(statement)

    def _operation(self, operation: Operation, operand: Callable[[Operand], Operand]) -> Operation:
        match operation:
            case Unary(function, argument):
                return Unary(function, operand(argument))
            case Binary(operator, left, right):
                return Binary(operator, operand(left), operand(right))
            case Select(condition, then, otherwise):
                return Select(condition, operand(then), operand(otherwise))
            case Convert(argument):
                return Convert(operand(argument))
            case Lookup(table, index):
                return Lookup(self._table(table), index)
            case _:
                assert_never(operation)

    def _table(self, table: Table) -> Table:
        values = tuple(
            self._change((table.name, number), Constant(table.kind, value)).value
            for number, value in enumerate(table.values)
        )
        return Table(table.name, table.kind, values)
