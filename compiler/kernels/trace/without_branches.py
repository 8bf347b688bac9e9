"""Rewrites a traced kernel to execute the same operations for every argument (constant time)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Call,
    Constant,
    Convert,
    Function,
    Local,
    Lookup,
    Operand,
    Operation,
    Operator,
    Routine,
    Select,
    Statement,
    Unary,
    ValueKind,
)

_BITS = {ValueKind.UNSIGNED: 32, ValueKind.WIDE: 64}


def without_branches(routine: Routine) -> Routine:
    """The routine with both blocks of each branch, after which its values are selected.

    Before: any routine. After: the same bits and no branch, in the routines that it calls neither.
    What a block may take for granted where it is chosen no longer holds, so the arguments of
    operations that C leaves undefined are replaced by 0 where they are outside their range.
    E.g. `if x > 0 { y = table[n] } else { y = 0 }` becomes
    `i = n < 9 ? n : 0; t = table[i]; y = x > 0 ? t : 0`.
    """
    return _Flattening(routine).result()


class _Flattening:
    def __init__(self, routine: Routine) -> None:
        self._routine = routine
        # numbers of new locals follow those of the routine
        self._count = max(local.index for local in _locals_within(routine))
        self._statements: list[Statement] = []

    def result(self) -> Routine:
        old = self._routine
        values = self._flatten(old.body)
        body = Block(tuple(self._statements), values)
        return Routine(
            name=old.name,
            doc=old.doc,
            format=old.format,
            parameters=old.parameters,
            results=old.results,
            body=body,
        )

    def _flatten(self, block: Block) -> tuple[Operand, ...]:
        for statement in block.statements:
            match statement:
                case Assign(target, operation):
                    guarded = self._guarded(operation, target.kind)
                    self._statements.append(Assign(target, guarded))
                case Call(targets, routine, arguments):
                    self._statements.append(Call(targets, without_branches(routine), arguments))
                case Branch(targets, condition, then, otherwise):
                    # both blocks run for every argument; their locals have unique numbers
                    first, second = self._flatten(then), self._flatten(otherwise)
                    for target, one, other in zip(targets, first, second, strict=True):
                        self._statements.append(Assign(target, Select(condition, one, other)))
                case _:
                    assert_never(statement)
        return block.values

    def _guarded(self, operation: Operation, kind: ValueKind) -> Operation:
        match operation:
            # a real beyond the integers, an index beyond a table, a shift by the width or more: C
            # leaves them undefined, and a block that is not chosen may now meet them
            case Convert(Local(_, ValueKind.REAL) as real):
                return Convert(self._within(real, 2.0 ** _BITS[kind]))
            case Lookup(table, Local() as index):
                return Lookup(table, self._below(index, len(table.values)))
            case Binary(Operator.SHIFT_LEFT | Operator.SHIFT_RIGHT as shift, value, Local() as by):
                return Binary(shift, value, self._below(by, _BITS[value.kind]))
            case Unary(Function.SQUARE_ROOT, Local() as radicand):
                return self._root(radicand)
            case _:
                return operation

    def _within(self, real: Local, limit: float) -> Operand:
        """The number if it lies in 0 ≤ x < limit, else 0."""
        above = self._new(Binary(Operator.GREATER_EQUAL, real, _ZERO), ValueKind.TRUTH)
        below = self._new(
            Binary(Operator.LESS, real, Constant(ValueKind.REAL, limit)), ValueKind.TRUTH
        )
        inside = self._new(Binary(Operator.BOTH, above, below), ValueKind.TRUTH)
        return self._new(Select(inside, real, _ZERO), ValueKind.REAL)

    def _below(self, index: Local, limit: int) -> Operand:
        """The integer if it is less than the limit, else 0."""
        inside = self._new(
            Binary(Operator.LESS, index, Constant(index.kind, limit)), ValueKind.TRUTH
        )
        return self._new(Select(inside, index, Constant(index.kind, 0)), index.kind)

    def _root(self, real: Local) -> Operation:
        """√x without a library's detour below zero: there it is 0 / 0, elsewhere √x / 1."""
        negative = self._new(Binary(Operator.LESS, real, _ZERO), ValueKind.TRUTH)
        radicand = self._new(Select(negative, _ZERO, real), ValueKind.REAL)
        root = self._new(Unary(Function.SQUARE_ROOT, radicand), ValueKind.REAL)
        divisor = self._new(Select(negative, _ZERO, _ONE), ValueKind.REAL)
        return Binary(Operator.DIVIDE, root, divisor)

    def _new(self, operation: Operation, kind: ValueKind) -> Local:
        self._count += 1
        target = Local(self._count, kind, "")
        self._statements.append(Assign(target, operation))
        return target


def _locals_within(routine: Routine) -> Iterator[Local]:
    """The parameters of a routine and every local that it assigns."""
    yield from routine.parameters
    yield from _assigned(routine.body)


def _assigned(block: Block) -> Iterator[Local]:
    for statement in block.statements:
        match statement:
            case Assign(target, _):
                yield target
            case Call(targets, _, _):
                yield from targets
            case Branch(targets, _, then, otherwise):
                yield from targets
                yield from _assigned(then)
                yield from _assigned(otherwise)
            case _:
                assert_never(statement)


_ZERO, _ONE = Constant(ValueKind.REAL, 0.0), Constant(ValueKind.REAL, 1.0)
