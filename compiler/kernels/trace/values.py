"""Records arithmetic on symbolic values in the tracer that they belong to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Constant,
    Function,
    Local,
    Operand,
    Operation,
    Operator,
    Statement,
    Unary,
    ValueKind,
)


class Tracer:
    """Collects the statements of one routine; blocks nest, locals are numbered over the routine."""

    def __init__(self, format: Format) -> None:
        self.format = format
        self._blocks: list[list[Statement]] = [[]]
        # numbered over all blocks, so that blocks never reuse a local of another
        self._count = 0

    def new_local(self, kind: ValueKind, hint: str = "") -> Local:
        self._count += 1
        return Local(self._count, kind, hint)

    def assign(self, operation: Operation, kind: ValueKind, hint: str = "") -> Operand:
        target = self.new_local(kind, hint)
        self.append(Assign(target, operation))
        return target

    def rename(self, local: Operand, hint: str) -> Operand:
        """The value under a name for the C text; its statement is the last one of the block."""
        last = self._blocks[-1][-1]
        assert isinstance(last, Assign), "only the newest value can be named"
        assert last.target == local, "only the newest value can be named"
        named = Local(last.target.index, last.target.kind, hint)
        self._blocks[-1][-1] = Assign(named, last.operation)
        return named

    def append(self, statement: Statement) -> None:
        self._blocks[-1].append(statement)

    def block(self, build: Callable[[], tuple[Value, ...]]) -> Block:
        """The statements that `build` performs, as a block of their own."""
        self._blocks.append([])
        values = build()
        return Block(tuple(self._blocks.pop()), tuple(value.operand for value in values))


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    """An operand together with the tracer that records what is done to it."""

    tracer: Tracer
    operand: Operand

    def _binary(
        self, operator: Operator, left: Operand, right: Operand, kind: ValueKind
    ) -> Operand:
        return self.tracer.assign(Binary(operator, left, right), kind)


@dataclass(frozen=True, slots=True, eq=False)
class Truth(Value):
    """A condition."""

    def __and__(self, other: Truth) -> Truth:
        operand = self._binary(Operator.BOTH, self.operand, other.operand, ValueKind.TRUTH)
        return Truth(self.tracer, operand)

    def __or__(self, other: Truth) -> Truth:
        operand = self._binary(Operator.EITHER, self.operand, other.operand, ValueKind.TRUTH)
        return Truth(self.tracer, operand)

    def __invert__(self) -> Truth:
        operation = Unary(Function.NOT, self.operand)
        return Truth(self.tracer, self.tracer.assign(operation, ValueKind.TRUTH))


@dataclass(frozen=True, slots=True, eq=False)
class Unsigned(Value):
    """An unsigned integer of 32 bits, or of 64 where its operand is WIDE."""

    @property
    def kind(self) -> ValueKind:
        return self.operand.kind

    def lift(self, other: Unsigned | int) -> Operand:
        """The operand of a value, or a constant of this value's kind."""
        return other.operand if isinstance(other, Unsigned) else Constant(self.kind, other)

    def _compute(self, operator: Operator, other: Unsigned | int) -> Unsigned:
        return Unsigned(
            self.tracer, self._binary(operator, self.operand, self.lift(other), self.kind)
        )

    def __add__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.ADD, other)

    def __sub__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.SUBTRACT, other)

    def __rsub__(self, other: int) -> Unsigned:
        return Unsigned(
            self.tracer,
            self._binary(Operator.SUBTRACT, Constant(self.kind, other), self.operand, self.kind),
        )

    def __mul__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.MULTIPLY, other)

    def __and__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.BITS_AND, other)

    def __or__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.BITS_OR, other)

    def __lshift__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.SHIFT_LEFT, other)

    def __rshift__(self, other: Unsigned | int) -> Unsigned:
        return self._compute(Operator.SHIFT_RIGHT, other)

    def __lt__(self, other: Unsigned | int) -> Truth:
        operand = self._binary(Operator.LESS, self.operand, self.lift(other), ValueKind.TRUTH)
        return Truth(self.tracer, operand)

    def __gt__(self, other: Unsigned | int) -> Truth:
        operand = self._binary(Operator.GREATER, self.operand, self.lift(other), ValueKind.TRUTH)
        return Truth(self.tracer, operand)


@dataclass(frozen=True, slots=True, eq=False)
class Real(Value):
    """A floating-point number of the routine's format."""

    @property
    def format(self) -> Format:
        return self.tracer.format

    def lift(self, other: Real | float) -> Operand:
        """The operand of a value, or a constant of this format."""
        return other.operand if isinstance(other, Real) else real_constant(other, self.format)

    def _compute(self, operator: Operator, left: Operand, right: Operand) -> Real:
        return Real(self.tracer, self._binary(operator, left, right, ValueKind.REAL))

    def _compare(self, operator: Operator, other: Real | float) -> Truth:
        operand = self._binary(operator, self.operand, self.lift(other), ValueKind.TRUTH)
        return Truth(self.tracer, operand)

    def __add__(self, other: Real | float) -> Real:
        return self._compute(Operator.ADD, self.operand, self.lift(other))

    def __radd__(self, other: float) -> Real:
        return self._compute(Operator.ADD, self.lift(other), self.operand)

    def __sub__(self, other: Real | float) -> Real:
        return self._compute(Operator.SUBTRACT, self.operand, self.lift(other))

    def __rsub__(self, other: float) -> Real:
        return self._compute(Operator.SUBTRACT, self.lift(other), self.operand)

    def __mul__(self, other: Real | float) -> Real:
        return self._compute(Operator.MULTIPLY, self.operand, self.lift(other))

    def __rmul__(self, other: float) -> Real:
        return self._compute(Operator.MULTIPLY, self.lift(other), self.operand)

    def __truediv__(self, other: Real | float) -> Real:
        return self._compute(Operator.DIVIDE, self.operand, self.lift(other))

    def __rtruediv__(self, other: float) -> Real:
        return self._compute(Operator.DIVIDE, self.lift(other), self.operand)

    def __neg__(self) -> Real:
        operation = Unary(Function.NEGATE, self.operand)
        return Real(self.tracer, self.tracer.assign(operation, ValueKind.REAL))

    def __abs__(self) -> Real:
        operation = Unary(Function.MAGNITUDE, self.operand)
        return Real(self.tracer, self.tracer.assign(operation, ValueKind.REAL))

    def __lt__(self, other: Real | float) -> Truth:
        return self._compare(Operator.LESS, other)

    def __le__(self, other: Real | float) -> Truth:
        return self._compare(Operator.LESS_EQUAL, other)

    def __gt__(self, other: Real | float) -> Truth:
        return self._compare(Operator.GREATER, other)

    def __ge__(self, other: Real | float) -> Truth:
        return self._compare(Operator.GREATER_EQUAL, other)

    def named(self, hint: str) -> Real:
        """The same value, under this name in the C text."""
        return Real(self.tracer, self.tracer.rename(self.operand, hint))


def real_constant(value: float, format: Format) -> Constant:
    """The number rounded to the format, so that every reader has the same one."""
    # through the format: 0.1 is another number in single precision, and C is to read that one
    return Constant(ValueKind.REAL, float(format.dtype.type(value)))


def symbolic(tracer: Tracer, target: Local) -> Value:
    """A local variable as a value of its kind."""
    match target.kind:
        case ValueKind.REAL:
            return Real(tracer, target)
        case ValueKind.TRUTH:
            return Truth(tracer, target)
        case ValueKind.UNSIGNED | ValueKind.WIDE:
            return Unsigned(tracer, target)
