"""Proves where the values of a kernel lie, so that no index leaves its table.

A condition narrows what it compares; what cannot be proved of a box is tried of its halves.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import assert_never

import numpy as np

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import (
    COMPARISONS,
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
    Unary,
    ValueKind,
)
from tests.kernels.intervals import (
    Interval,
    NotProvedError,
    compared,
    every,
    halves,
    joined,
    number_at,
    of_one,
    of_reals,
    of_whole_numbers,
    ordinal,
)

_BITS = {ValueKind.UNSIGNED: 32, ValueKind.WIDE: 64}
_OPPOSITE = {
    Operator.LESS: Operator.GREATER_EQUAL,
    Operator.LESS_EQUAL: Operator.GREATER,
    Operator.GREATER: Operator.LESS_EQUAL,
    Operator.GREATER_EQUAL: Operator.LESS,
}


def prove(routine: Routine, box: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """Where the results lie; raises NotProvedError if an index, a shift or a cut might not do."""
    try:
        return _Run(routine.format).routine(routine, box)
    except NotProvedError:
        parts = halves(box[0], routine.format)
        if not parts:
            raise
        return joined(*(prove(routine, (part, *box[1:])) for part in parts))


@dataclass(slots=True)
class _Run:
    format: Format
    values: dict[int, Interval] = field(default_factory=dict[int, Interval])
    made: dict[int, Operation] = field(default_factory=dict[int, Operation])

    def routine(self, routine: Routine, box: tuple[Interval, ...]) -> tuple[Interval, ...]:
        for parameter, interval in zip(routine.parameters, box, strict=True):
            self.values[parameter.index] = interval
        with np.errstate(all="ignore"):
            return self._block(routine.body)

    def _block(self, block: Block) -> tuple[Interval, ...]:
        for statement in block.statements:
            match statement:
                case Assign(target, operation):
                    self.values[target.index] = self._operation(operation, target.kind)
                    self.made[target.index] = operation
                case Call(targets, routine, operands):
                    results = prove(routine, tuple(map(self._read, operands)))
                    self._store(targets, results)
                case Branch(targets, condition, then, otherwise):
                    sides = ((then, True), (otherwise, False))
                    found = [self._side(condition, *side) for side in sides]
                    reached = [one for one in found if one is not None]
                    self._store(targets, joined(*reached))
                case _:
                    assert_never(statement)
        return tuple(map(self._read, block.values))

    def _store(self, targets: tuple[Local, ...], results: tuple[Interval, ...]) -> None:
        for target, result in zip(targets, results, strict=True):
            self.values[target.index] = result

    def _side(self, condition: Operand, block: Block, holds: bool) -> tuple[Interval, ...] | None:
        """The values of a block where the condition is so; None where it never is."""
        inner = _Run(self.format, dict(self.values), dict(self.made))
        inner._narrow(condition, holds)
        truth = self._read(condition)
        never = (truth.high if holds else 1 - truth.low) == 0
        if never or any(one.empty for one in inner.values.values()):
            return None
        return inner._block(block)

    def _narrow(self, condition: Operand, holds: bool) -> None:
        """What is compared, as far as the outcome tells."""
        operation = self.made.get(condition.index) if isinstance(condition, Local) else None
        match operation:
            case Binary(Operator.BOTH, left, right) if holds:
                self._narrow(left, holds)
                self._narrow(right, holds)
            case Binary(Operator.EITHER, left, right) if not holds:
                self._narrow(left, holds)
                self._narrow(right, holds)
            case Unary(Function.NOT, operand):
                self._narrow(operand, not holds)
            case Binary(operator, left, right) if operator in COMPARISONS:
                self._compare(operator if holds else _OPPOSITE[operator], left, right, holds)
            case _:
                pass

    def _compare(self, operator: Operator, left: Operand, right: Operand, holds: bool) -> None:
        if operator in (Operator.GREATER, Operator.GREATER_EQUAL):
            left, right = right, left
        small, large = self._read(left), self._read(right)
        # a comparison with NaN is false whatever the other operand is
        for operand, own, other in ((left, small, large), (right, large, small)):
            if not isinstance(operand, Local) or (other.nan and not holds):
                continue
            low = own.low if operand is left else max(own.low, other.low)
            high = min(own.high, other.high) if operand is left else own.high
            self.values[operand.index] = Interval(low, high, own.nan and not holds)

    def _read(self, operand: Operand) -> Interval:
        match operand:
            case Local():
                return self.values[operand.index]
            case Constant(ValueKind.REAL, value):
                number = self.format.dtype.type(value)
                return Interval(number, number)
            case Constant(_, value):
                return Interval(int(value), int(value))
            case _:
                assert_never(operand)

    def _operation(self, operation: Operation, kind: ValueKind) -> Interval:
        match operation:
            case Unary(function, operand):
                return of_one(function, self._read(operand))
            case Binary(Operator.SUBTRACT, left, right) if self._is_cut(left, right):
                below_one = number_at(ordinal(1.0, self.format) - 1, self.format)
                return Interval(below_one * 0, below_one)
            case Binary(operator, left, right):
                return self._binary(operator, left, right, kind)
            case Select(condition, then, otherwise):
                truth = self._read(condition)
                sides = [self._read(then)] * truth.high + [self._read(otherwise)] * (1 - truth.low)
                return sides[0].join(sides[-1])
            case Convert(operand):
                return self._convert(operand, kind)
            case Lookup(table, index):
                where = self._read(index)
                if not 0 <= where.low <= where.high < len(table.values):
                    raise NotProvedError(f"{table.name}[{where}]")
                entries = table.values[where.low : where.high + 1]
                made = self.format.dtype.type if kind is ValueKind.REAL else int
                return Interval(made(min(entries)), made(max(entries)))
            case _:
                assert_never(operation)

    def _is_cut(self, whole: Operand, part: Operand) -> bool:
        """Whether it is x less its integer part, which is exact and below 1."""
        match self._made(part):
            case Convert(operand):
                match self._made(operand):
                    case Convert(cut):
                        return cut == whole
                    case _:
                        return False
            case _:
                return False

    def _made(self, operand: Operand) -> Operation | None:
        return self.made.get(operand.index) if isinstance(operand, Local) else None

    def _convert(self, operand: Operand, kind: ValueKind) -> Interval:
        one = self._read(operand)
        if kind is ValueKind.REAL:
            return Interval(self.format.dtype.type(one.low), self.format.dtype.type(one.high))
        last = 2 ** _BITS[kind] - 1
        if operand.kind is ValueKind.REAL:
            # C says nothing of NaN and of what does not fit
            if one.nan or not -1 < one.low <= one.high < last + 1:
                raise NotProvedError(f"{one} as {kind}")
            return Interval(int(one.low), int(one.high))
        return one if one.high <= last else Interval(0, last)

    def _binary(
        self, operator: Operator, left: Operand, right: Operand, kind: ValueKind
    ) -> Interval:
        first, second = self._read(left), self._read(right)
        if operator in COMPARISONS:
            return compared(operator, first, second)
        if operator is Operator.BOTH:
            return Interval(min(first.low, second.low), min(first.high, second.high))
        if operator is Operator.EITHER:
            return Interval(max(first.low, second.low), max(first.high, second.high))
        if kind is ValueKind.REAL:
            return of_reals(operator, first, second, every(self.format))
        return of_whole_numbers(operator, first, second, _BITS[kind])
