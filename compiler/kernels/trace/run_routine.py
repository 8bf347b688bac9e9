"""Executes a traced routine on numpy arrays, element by element, with the bits of its C text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.tables.formats import Format
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
    Unary,
    ValueKind,
)

Array = NDArray[Any]

_OPERATORS: dict[Operator, Callable[[Array, Array], Array]] = {
    Operator.ADD: np.add,
    Operator.SUBTRACT: np.subtract,
    Operator.MULTIPLY: np.multiply,
    Operator.DIVIDE: np.divide,
    Operator.SHIFT_LEFT: np.left_shift,
    Operator.SHIFT_RIGHT: np.right_shift,
    Operator.BITS_AND: np.bitwise_and,
    Operator.BITS_OR: np.bitwise_or,
    Operator.LESS: np.less,
    Operator.LESS_EQUAL: np.less_equal,
    Operator.GREATER: np.greater,
    Operator.GREATER_EQUAL: np.greater_equal,
    Operator.BOTH: np.logical_and,
    Operator.EITHER: np.logical_or,
}

_FUNCTIONS: dict[Function, Callable[[Array], Array]] = {
    Function.NEGATE: np.negative,
    Function.MAGNITUDE: np.abs,
    Function.SQUARE_ROOT: np.sqrt,
    Function.NOT: np.logical_not,
}


Outcome = tuple[tuple[int, ...], bool]
"""Which condition (ids of statements, while the routine lives, and operands), and what it was."""

Note = Callable[[Outcome, NDArray[np.bool_]], None]
"""Is told which elements had an outcome."""


def run_routine(
    routine: Routine, arguments: tuple[Array, ...], note: Note | None = None
) -> tuple[Array, ...]:
    """The results of a routine for arrays of one shape, at least 1-D, in the routine's format.

    Where a branch goes both ways within an array, both blocks run on all of it and the condition
    picks; what the other block makes of elements that are not its own is discarded, silently.
    `note` is told of every outcome of a condition, for the elements for which C would look at it.
    """
    values = {
        parameter.index: argument
        for parameter, argument in zip(routine.parameters, arguments, strict=True)
    }
    watch = None if note is None else _Watch(note, np.ones(arguments[0].shape, np.bool_), {})
    # elements of the block that is not theirs may divide by 0: their results are thrown away
    with np.errstate(all="ignore"):
        return _run_block(routine.body, values, routine.format, watch)


@dataclass(frozen=True, slots=True)
class _Watch:
    """Tells of conditions, for the elements that C would compute here."""

    note: Note
    present: NDArray[np.bool_]
    joined: dict[Operand, Assign]
    """What was made by && and ||: C may write it where it is used."""

    def tell(self, which: tuple[int, ...], condition: Array) -> None:
        self.note((which, True), self.present & condition)
        self.note((which, False), self.present & ~condition)

    def where(self, condition: Array) -> _Watch:
        return _Watch(self.note, self.present & condition, self.joined)

    def called(self) -> _Watch:
        # the locals of the called routine are numbered anew, so nothing joined here is known there
        return _Watch(self.note, self.present, {})

    def operation(self, statement: Assign, values: dict[int, Array], format: Format) -> None:
        match statement.operation:
            case Binary(Operator.BOTH | Operator.EITHER):
                self._decide((id(statement),), statement, values, format)
                self.joined[statement.target] = statement
            case Select(condition):
                self.tell((id(statement),), _read(condition, values, format))
            case _:
                pass

    def _decide(
        self, which: tuple[int, ...], statement: Assign, values: dict[int, Array], format: Format
    ) -> None:
        """The second operand is looked at where the first does not decide, and so on in it."""
        assert isinstance(statement.operation, Binary)
        left, right = statement.operation.left, statement.operation.right
        first = _read(left, values, format)
        decided = ~first if statement.operation.operator is Operator.BOTH else first
        for number, (operand, watch) in enumerate(((left, self), (right, self.where(~decided)))):
            # C stops at the first operand that decides: the second counts as looked at only
            # elsewhere
            watch.tell((*which, number), _read(operand, values, format))
            # an operand that is itself made by && or || is decided operand by operand too
            if operand in self.joined:
                watch._decide((*which, number), self.joined[operand], values, format)


def _run_block(
    block: Block, values: dict[int, Array], format: Format, watch: _Watch | None
) -> tuple[Array, ...]:
    for statement in block.statements:
        match statement:
            case Assign(target, operation):
                if watch is not None:
                    watch.operation(statement, values, format)
                values[target.index] = _apply(operation, target.kind, values, format)
            case Call(targets, routine, operands):
                arguments = tuple(_read(operand, values, format) for operand in operands)
                called = {
                    parameter.index: argument
                    for parameter, argument in zip(routine.parameters, arguments, strict=True)
                }
                within = None if watch is None else watch.called()
                _store(targets, _run_block(routine.body, called, format, within), values)
            case Branch(targets, condition, then, otherwise):
                holds = _read(condition, values, format)
                here = there = None
                if watch is not None:
                    watch.tell((id(statement),), holds)
                    here, there = watch.where(holds), watch.where(~holds)
                if holds.all():
                    _store(targets, _run_block(then, values, format, here), values)
                # an array that takes one side does not compute the other, which is usually the dear
                # one
                elif not holds.any():
                    _store(targets, _run_block(otherwise, values, format, there), values)
                else:
                    first = _run_block(then, values, format, here)
                    second = _run_block(otherwise, values, format, there)
                    chosen = (
                        np.where(holds, one, other)
                        for one, other in zip(first, second, strict=True)
                    )
                    _store(targets, tuple(chosen), values)
            case _:
                assert_never(statement)
    return tuple(_read(value, values, format) for value in block.values)


def _store(
    targets: tuple[Local, ...], results: tuple[Array, ...], values: dict[int, Array]
) -> None:
    for target, result in zip(targets, results, strict=True):
        values[target.index] = result


def _apply(
    operation: Operation, kind: ValueKind, values: dict[int, Array], format: Format
) -> Array:
    match operation:
        case Unary(function, operand):
            return _FUNCTIONS[function](_read(operand, values, format))
        case Binary(operator, left, right):
            return _OPERATORS[operator](_read(left, values, format), _read(right, values, format))
        case Select(condition, then, otherwise):
            return np.where(
                _read(condition, values, format),
                _read(then, values, format),
                _read(otherwise, values, format),
            )
        case Convert(operand):
            return _read(operand, values, format).astype(_dtype(kind, format))
        case Lookup(table, index):
            entries = np.array(table.values, dtype=_dtype(table.kind, format))
            # "clip" concerns only elements of the block that is not chosen
            return entries.take(_read(index, values, format), mode="clip")
        case _:
            assert_never(operation)


def _read(operand: Operand, values: dict[int, Array], format: Format) -> Array:
    match operand:
        case Local():
            return values[operand.index]
        case Constant(kind, value):
            return np.asarray(value, dtype=_dtype(kind, format))
        case _:
            assert_never(operand)


def _dtype(kind: ValueKind, format: Format) -> np.dtype[Any]:
    match kind:
        case ValueKind.REAL:
            return format.dtype
        case ValueKind.UNSIGNED:
            return np.dtype(np.uint32)
        case ValueKind.WIDE:
            return np.dtype(np.uint64)
        case ValueKind.TRUTH:
            return np.dtype(np.bool_)
        case _:
            assert_never(kind)
