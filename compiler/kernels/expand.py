"""Expands a math kernel into core operations, for backends that lack an exact function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.kernels.table import routine
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
    Select,
    Unary,
)


def expand_kernel(builder: GraphBuilder, name: str, args: tuple[NodeId, ...]) -> NodeId:
    """Adds the double version of the kernel `name` to the graph, one node per operation, for the
    argument nodes `args`. Returns the node of the result.

    A branch becomes a `Select` between the results of both sides. Raises ValueError for a kernel
    that needs integers (exp, sin and kernels that call them), which the core operations lack.
    """
    kernel = routine(name, "double")
    values: dict[int, _Value] = {}
    for parameter, arg in zip(kernel.parameters, args, strict=True):
        values[parameter.index] = arg
    (result,) = _Expansion(builder, name).block(kernel.body, values)
    return _number(result)


# Conditions stay symbolic until a selection: the core operations lack and, or, not.
@dataclass(frozen=True, slots=True)
class _Both:
    left: _Truth
    right: _Truth


@dataclass(frozen=True, slots=True)
class _Either:
    left: _Truth
    right: _Truth


@dataclass(frozen=True, slots=True)
class _Not:
    operand: _Truth


@dataclass(frozen=True, slots=True)
class _Holds:
    comparison: NodeId


_Truth = _Both | _Either | _Not | _Holds
_Value = NodeId | _Truth

_RELATIONS = {
    Operator.LESS: Relation.LESS,
    Operator.LESS_EQUAL: Relation.LESS_EQUAL,
    Operator.GREATER: Relation.GREATER,
    Operator.GREATER_EQUAL: Relation.GREATER_EQUAL,
}


def _number(value: _Value) -> NodeId:
    assert isinstance(value, int), "a condition where the kernel has a number"
    return value


def _truth(value: _Value) -> _Truth:
    assert not isinstance(value, int), "a number where the kernel has a condition"
    return value


@dataclass(frozen=True, slots=True)
class _Expansion:
    builder: GraphBuilder
    name: str

    def block(self, block: Block, values: dict[int, _Value]) -> tuple[_Value, ...]:
        for statement in block.statements:
            match statement:
                case Assign(target, operation):
                    values[target.index] = self._operation(operation, values)
                case Call(targets, called, operands):
                    inner = {
                        parameter.index: self._operand(operand, values)
                        for parameter, operand in zip(called.parameters, operands, strict=True)
                    }
                    self._store(targets, self.block(called.body, inner), values)
                case Branch(targets, condition, then, otherwise):
                    # no control flow in a graph: both blocks are computed and one result is
                    # selected
                    holds = _truth(self._operand(condition, values))
                    # locals are numbered over the whole routine: blocks do not overwrite each other
                    first = self.block(then, values)
                    second = self.block(otherwise, values)
                    chosen = tuple(
                        self._choice(holds, _number(one), _number(other))
                        for one, other in zip(first, second, strict=True)
                    )
                    self._store(targets, chosen, values)
                case _:
                    assert_never(statement)
        return tuple(self._operand(value, values) for value in block.values)

    def _store(
        self, targets: tuple[Local, ...], results: tuple[_Value, ...], values: dict[int, _Value]
    ) -> None:
        for target, result in zip(targets, results, strict=True):
            values[target.index] = result

    def _operand(self, operand: Operand, values: dict[int, _Value]) -> _Value:
        match operand:
            case Local():
                return values[operand.index]
            case Constant():
                # unit None: kernels are not part of the unit check
                return self.builder.constant(operand.value, unit=None)
            case _:
                assert_never(operand)

    def _operation(self, operation: Operation, values: dict[int, _Value]) -> _Value:
        match operation:
            case Unary(function, operand):
                return self._unary(function, self._operand(operand, values))
            case Binary(operator, left, right):
                return self._binary(
                    operator, self._operand(left, values), self._operand(right, values)
                )
            case Select(condition, then, otherwise):
                return self._choice(
                    _truth(self._operand(condition, values)),
                    _number(self._operand(then, values)),
                    _number(self._operand(otherwise, values)),
                )
            case Convert() | Lookup():
                raise self._needs_integers()
            case _:
                assert_never(operation)

    def _unary(self, function: Function, operand: _Value) -> _Value:
        match function:
            case Function.NEGATE:
                return self.builder.negate(_number(operand))
            case Function.MAGNITUDE:
                return self.builder.apply("abs", _number(operand))
            case Function.SQUARE_ROOT:
                return self.builder.apply("sqrt", _number(operand))
            case Function.NOT:
                return _Not(_truth(operand))
            case _:
                assert_never(function)

    def _binary(self, operator: Operator, left: _Value, right: _Value) -> _Value:
        b = self.builder
        match operator:
            case Operator.ADD:
                return b.add(_number(left), _number(right))
            case Operator.SUBTRACT:
                return b.subtract(_number(left), _number(right))
            case Operator.MULTIPLY:
                return b.multiply(_number(left), _number(right))
            case Operator.DIVIDE:
                return b.divide(_number(left), _number(right))
            case Operator.BOTH:
                return _Both(_truth(left), _truth(right))
            case Operator.EITHER:
                return _Either(_truth(left), _truth(right))
            case Operator.LESS | Operator.LESS_EQUAL | Operator.GREATER | Operator.GREATER_EQUAL:
                return _Holds(b.compare(_RELATIONS[operator], _number(left), _number(right)))
            case Operator.SHIFT_LEFT | Operator.SHIFT_RIGHT | Operator.BITS_AND | Operator.BITS_OR:
                raise self._needs_integers()
            case _:
                assert_never(operator)

    def _choice(self, holds: _Truth, then: NodeId, otherwise: NodeId) -> NodeId:
        match holds:
            case _Holds(comparison):
                return self.builder.select(comparison, then, otherwise)
            case _Not(operand):
                return self._choice(operand, otherwise, then)
            case _Both(left, right):
                # the core operations have no "and": nest two selections
                return self._choice(left, self._choice(right, then, otherwise), otherwise)
            case _Either(left, right):
                return self._choice(left, then, self._choice(right, then, otherwise))
            case _:
                assert_never(holds)

    def _needs_integers(self) -> ValueError:
        return ValueError(f"`{self.name}` needs integer operations, which core ops do not have")
