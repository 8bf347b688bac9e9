"""Executes a traced routine on numpy arrays, element by element, with the same bits as
its C code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace import statements as traced

Array = NDArray[Any]

_OPERATORS: dict[traced.Operator, Callable[[Array, Array], Array]] = {
    traced.Operator.ADD: np.add,
    traced.Operator.SUBTRACT: np.subtract,
    traced.Operator.MULTIPLY: np.multiply,
    traced.Operator.DIVIDE: np.divide,
    traced.Operator.SHIFT_LEFT: np.left_shift,
    traced.Operator.SHIFT_RIGHT: np.right_shift,
    traced.Operator.BITS_AND: np.bitwise_and,
    traced.Operator.BITS_OR: np.bitwise_or,
    traced.Operator.LESS: np.less,
    traced.Operator.LESS_EQUAL: np.less_equal,
    traced.Operator.GREATER: np.greater,
    traced.Operator.GREATER_EQUAL: np.greater_equal,
    traced.Operator.BOTH: np.logical_and,
    traced.Operator.EITHER: np.logical_or,
}

_FUNCTIONS: dict[traced.Function, Callable[[Array], Array]] = {
    traced.Function.NEGATE: np.negative,
    traced.Function.MAGNITUDE: np.abs,
    traced.Function.SQUARE_ROOT: np.sqrt,
    traced.Function.NOT: np.logical_not,
}


Outcome = tuple[tuple[int, ...], bool]
"""A condition (ids of its statements during the run, and operands) and its value."""

Note = Callable[[Outcome, NDArray[np.bool_]], None]
"""A callback that receives an outcome and a mask of the elements that had it."""


def run_routine(
    routine: traced.Routine, arguments: tuple[Array, ...], note: Note | None = None
) -> tuple[Array, ...]:
    """The results of a routine, one array each, for one array per parameter: all of one shape, at
    least 1-D, in the routine's format.

    If a branch differs between elements, both blocks run on the whole array and the condition
    selects. Warnings of discarded elements are suppressed. `note` receives both outcomes of each
    condition, with a mask of the elements for which C would evaluate it to that outcome.
    """
    values = {
        parameter.index: argument
        for parameter, argument in zip(routine.parameters, arguments, strict=True)
    }
    watch = None if note is None else _Watch(note, np.ones(arguments[0].shape, np.bool_), {})
    # discarded elements may divide by 0
    with np.errstate(all="ignore"):
        return _run_block(routine.body, values, routine.format, watch)


@dataclass(frozen=True, slots=True)
class _Watch:
    """Reports the outcomes of conditions to `note`, for the elements at which C would evaluate
    them; `present` is their mask.
    """

    note: Note
    present: NDArray[np.bool_]
    joined: dict[traced.Operand, traced.Assign]
    """Results of && and ||, which C may write at the place of their use."""

    def tell(self, which: tuple[int, ...], condition: Array) -> None:
        self.note((which, True), self.present & condition)
        self.note((which, False), self.present & ~condition)

    def where(self, condition: Array) -> _Watch:
        return _Watch(self.note, self.present & condition, self.joined)

    def called(self) -> _Watch:
        # the called routine has its own numbering of locals
        return _Watch(self.note, self.present, {})

    def operation(self, statement: traced.Assign, values: dict[int, Array], format: Format) -> None:
        match statement.operation:
            case traced.Binary(traced.Operator.BOTH | traced.Operator.EITHER):
                self._decide((id(statement),), statement, values, format)
                self.joined[statement.target] = statement
            case traced.Select(condition):
                self.tell((id(statement),), _read(condition, values, format))
            case _:
                pass

    def _decide(
        self,
        which: tuple[int, ...],
        statement: traced.Assign,
        values: dict[int, Array],
        format: Format,
    ) -> None:
        """Reports the outcomes of both operands of `statement`, a && or ||. C evaluates the second
        operand only where the first does not decide. `which` are the ids under which the outcomes
        are reported.
        """
        assert isinstance(statement.operation, traced.Binary)
        left, right = statement.operation.left, statement.operation.right
        first = _read(left, values, format)
        decided = ~first if statement.operation.operator is traced.Operator.BOTH else first
        for number, (operand, watch) in enumerate(((left, self), (right, self.where(~decided)))):
            # C stops at the first deciding operand: the second is evaluated elsewhere only
            watch.tell((*which, number), _read(operand, values, format))
            # an operand that is a result of && or || is evaluated the same way
            if operand in self.joined:
                watch._decide((*which, number), self.joined[operand], values, format)


def _run_block(
    block: traced.Block, values: dict[int, Array], format: Format, watch: _Watch | None
) -> tuple[Array, ...]:
    for statement in block.statements:
        match statement:
            case traced.Assign(target, operation):
                if watch is not None:
                    watch.operation(statement, values, format)
                values[target.index] = _apply(operation, target.kind, values, format)
            case traced.Call(targets, routine, operands):
                arguments = tuple(_read(operand, values, format) for operand in operands)
                called = {
                    parameter.index: argument
                    for parameter, argument in zip(routine.parameters, arguments, strict=True)
                }
                within = None if watch is None else watch.called()
                _store(targets, _run_block(routine.body, called, format, within), values)
            case traced.Branch(targets, condition, then, otherwise):
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
    targets: tuple[traced.Local, ...], results: tuple[Array, ...], values: dict[int, Array]
) -> None:
    for target, result in zip(targets, results, strict=True):
        values[target.index] = result


def _apply(
    operation: traced.Operation, kind: traced.ValueKind, values: dict[int, Array], format: Format
) -> Array:
    match operation:
        case traced.Unary(function, operand):
            return _FUNCTIONS[function](_read(operand, values, format))
        case traced.Binary(operator, left, right):
            return _OPERATORS[operator](_read(left, values, format), _read(right, values, format))
        case traced.Select(condition, then, otherwise):
            return np.where(
                _read(condition, values, format),
                _read(then, values, format),
                _read(otherwise, values, format),
            )
        case traced.Convert(operand):
            return _read(operand, values, format).astype(_dtype(kind, format))
        case traced.Lookup(table, index):
            entries = np.array(table.values, dtype=_dtype(table.kind, format))
            # "clip" concerns only elements of the block that is not chosen
            return entries.take(_read(index, values, format), mode="clip")
        case _:
            assert_never(operation)


def _read(operand: traced.Operand, values: dict[int, Array], format: Format) -> Array:
    match operand:
        case traced.Local():
            return values[operand.index]
        case traced.Constant(kind, value):
            return np.asarray(value, dtype=_dtype(kind, format))
        case _:
            assert_never(operand)


def _dtype(kind: traced.ValueKind, format: Format) -> np.dtype[Any]:
    match kind:
        case traced.ValueKind.REAL:
            return format.dtype
        case traced.ValueKind.UNSIGNED:
            return np.dtype(np.uint32)
        case traced.ValueKind.WIDE:
            return np.dtype(np.uint64)
        case traced.ValueKind.TRUTH:
            return np.dtype(np.bool_)
        case _:
            assert_never(kind)
