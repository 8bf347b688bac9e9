"""Proves where the values of a kernel lie, so that no index leaves its table.

A condition narrows what it compares; what cannot be proved of a box is tried of its halves.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import assert_never

import numpy as np

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace import statements as traced
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

_BITS = {traced.ValueKind.UNSIGNED: 32, traced.ValueKind.WIDE: 64}
_OPPOSITE = {
    traced.Operator.LESS: traced.Operator.GREATER_EQUAL,
    traced.Operator.LESS_EQUAL: traced.Operator.GREATER,
    traced.Operator.GREATER: traced.Operator.LESS_EQUAL,
    traced.Operator.GREATER_EQUAL: traced.Operator.LESS,
}


def prove(routine: traced.Routine, box: tuple[Interval, ...]) -> tuple[Interval, ...]:
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
    made: dict[int, traced.Operation] = field(default_factory=dict[int, traced.Operation])

    def routine(self, routine: traced.Routine, box: tuple[Interval, ...]) -> tuple[Interval, ...]:
        for parameter, interval in zip(routine.parameters, box, strict=True):
            self.values[parameter.index] = interval
        with np.errstate(all="ignore"):
            return self._block(routine.body)

    def _block(self, block: traced.Block) -> tuple[Interval, ...]:
        for statement in block.statements:
            match statement:
                case traced.Assign(target, operation):
                    self.values[target.index] = self._operation(operation, target.kind)
                    self.made[target.index] = operation
                case traced.Call(targets, routine, operands):
                    results = prove(routine, tuple(map(self._read, operands)))
                    self._store(targets, results)
                case traced.Branch(targets, condition, then, otherwise):
                    sides = ((then, True), (otherwise, False))
                    found = [self._side(condition, *side) for side in sides]
                    reached = [one for one in found if one is not None]
                    self._store(targets, joined(*reached))
                case _:
                    assert_never(statement)
        return tuple(map(self._read, block.values))

    def _store(self, targets: tuple[traced.Local, ...], results: tuple[Interval, ...]) -> None:
        for target, result in zip(targets, results, strict=True):
            self.values[target.index] = result

    def _side(
        self, condition: traced.Operand, block: traced.Block, holds: bool
    ) -> tuple[Interval, ...] | None:
        """The values of a block where the condition is so; None where it never is."""
        inner = _Run(self.format, dict(self.values), dict(self.made))
        inner._narrow(condition, holds)
        truth = self._read(condition)
        never = (truth.high if holds else 1 - truth.low) == 0
        if never or any(one.empty for one in inner.values.values()):
            return None
        return inner._block(block)

    def _narrow(self, condition: traced.Operand, holds: bool) -> None:
        """What is compared, as far as the outcome tells."""
        operation = self.made.get(condition.index) if isinstance(condition, traced.Local) else None
        match operation:
            case traced.Binary(traced.Operator.BOTH, left, right) if holds:
                self._narrow(left, holds)
                self._narrow(right, holds)
            case traced.Binary(traced.Operator.EITHER, left, right) if not holds:
                self._narrow(left, holds)
                self._narrow(right, holds)
            case traced.Unary(traced.Function.NOT, operand):
                self._narrow(operand, not holds)
            case traced.Binary(operator, left, right) if operator in traced.COMPARISONS:
                self._compare(operator if holds else _OPPOSITE[operator], left, right, holds)
            case _:
                pass

    def _compare(
        self, operator: traced.Operator, left: traced.Operand, right: traced.Operand, holds: bool
    ) -> None:
        if operator in (traced.Operator.GREATER, traced.Operator.GREATER_EQUAL):
            left, right = right, left
        small, large = self._read(left), self._read(right)
        # a comparison with NaN is false whatever the other operand is
        for operand, own, other in ((left, small, large), (right, large, small)):
            if not isinstance(operand, traced.Local) or (other.nan and not holds):
                continue
            low = own.low if operand is left else max(own.low, other.low)
            high = min(own.high, other.high) if operand is left else own.high
            self.values[operand.index] = Interval(low, high, own.nan and not holds)

    def _read(self, operand: traced.Operand) -> Interval:
        match operand:
            case traced.Local():
                return self.values[operand.index]
            case traced.Constant(traced.ValueKind.REAL, value):
                number = self.format.dtype.type(value)
                return Interval(number, number)
            case traced.Constant(_, value):
                return Interval(int(value), int(value))
            case _:
                assert_never(operand)

    def _operation(self, operation: traced.Operation, kind: traced.ValueKind) -> Interval:
        match operation:
            case traced.Unary(function, operand):
                return of_one(function, self._read(operand))
            case traced.Binary(traced.Operator.SUBTRACT, left, right) if self._is_cut(left, right):
                below_one = number_at(ordinal(1.0, self.format) - 1, self.format)
                return Interval(below_one * 0, below_one)
            case traced.Binary(operator, left, right):
                return self._binary(operator, left, right, kind)
            case traced.Select(condition, then, otherwise):
                truth = self._read(condition)
                sides = [self._read(then)] * truth.high + [self._read(otherwise)] * (1 - truth.low)
                return sides[0].join(sides[-1])
            case traced.Convert(operand):
                return self._convert(operand, kind)
            case traced.Lookup(table, index):
                where = self._read(index)
                if not 0 <= where.low <= where.high < len(table.values):
                    raise NotProvedError(f"{table.name}[{where}]")
                entries = table.values[where.low : where.high + 1]
                made = self.format.dtype.type if kind is traced.ValueKind.REAL else int
                return Interval(made(min(entries)), made(max(entries)))
            case _:
                assert_never(operation)

    def _is_cut(self, whole: traced.Operand, part: traced.Operand) -> bool:
        """Whether it is x less its integer part, which is exact and below 1."""
        match self._made(part):
            case traced.Convert(operand):
                match self._made(operand):
                    case traced.Convert(cut):
                        return cut == whole
                    case _:
                        return False
            case _:
                return False

    def _made(self, operand: traced.Operand) -> traced.Operation | None:
        return self.made.get(operand.index) if isinstance(operand, traced.Local) else None

    def _convert(self, operand: traced.Operand, kind: traced.ValueKind) -> Interval:
        one = self._read(operand)
        if kind is traced.ValueKind.REAL:
            return Interval(self.format.dtype.type(one.low), self.format.dtype.type(one.high))
        last = 2 ** _BITS[kind] - 1
        if operand.kind is traced.ValueKind.REAL:
            # C says nothing of NaN and of what does not fit
            if one.nan or not -1 < one.low <= one.high < last + 1:
                raise NotProvedError(f"{one} as {kind}")
            return Interval(int(one.low), int(one.high))
        return one if one.high <= last else Interval(0, last)

    def _binary(
        self,
        operator: traced.Operator,
        left: traced.Operand,
        right: traced.Operand,
        kind: traced.ValueKind,
    ) -> Interval:
        first, second = self._read(left), self._read(right)
        if operator in traced.COMPARISONS:
            return compared(operator, first, second)
        if operator is traced.Operator.BOTH:
            return Interval(min(first.low, second.low), min(first.high, second.high))
        if operator is traced.Operator.EITHER:
            return Interval(max(first.low, second.low), max(first.high, second.high))
        if kind is traced.ValueKind.REAL:
            return of_reals(operator, first, second, every(self.format))
        return of_whole_numbers(operator, first, second, _BITS[kind])
