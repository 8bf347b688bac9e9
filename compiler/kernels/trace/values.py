"""Symbolic values with overloaded operators: arithmetic on them adds statements to their
`Tracer`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import cast

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
    Statement,
    Table,
    Unary,
    ValueKind,
    drop_unused,
)


class Tracer:
    """Collects the statements of one routine in a format. Blocks nest; local variables are numbered
    over the whole routine.
    """

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
        """The same local variable with the name `hint` in the C code. It must be the target of the
        last statement of the current block, otherwise AssertionError.
        """
        last = self._blocks[-1][-1]
        assert isinstance(last, Assign), "only the newest value can be named"
        assert last.target == local, "only the newest value can be named"
        named = Local(last.target.index, last.target.kind, hint)
        self._blocks[-1][-1] = Assign(named, last.operation)
        return named

    def append(self, statement: Statement) -> None:
        self._blocks[-1].append(statement)

    def block(self, build: Callable[[], tuple[Value, ...]]) -> Block:
        """Runs `build` and returns the statements that it adds as a block of their own, with the
        values that it returns as the block's results.
        """
        self._blocks.append([])
        values = build()
        return Block(tuple(self._blocks.pop()), tuple(value.operand for value in values))


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    """A local variable or constant, with the tracer to which operations on it add their
    statements.
    """

    tracer: Tracer
    operand: Operand

    def _binary(
        self, operator: Operator, left: Operand, right: Operand, kind: ValueKind
    ) -> Operand:
        return self.tracer.assign(Binary(operator, left, right), kind)


@dataclass(frozen=True, slots=True, eq=False)
class Truth(Value):
    """A symbolic condition; `&`, `|` and `~` combine conditions."""

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
    """A symbolic unsigned integer of 32 bits, or of 64 if the kind of its operand is WIDE."""

    @property
    def kind(self) -> ValueKind:
        return self.operand.kind

    def lift(self, other: Unsigned | int) -> Operand:
        """The operand of `other`; a Python integer becomes a constant of this value's kind."""
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
    """A symbolic floating-point number in the routine's format."""

    @property
    def format(self) -> Format:
        return self.tracer.format

    def lift(self, other: Real | float) -> Operand:
        """The operand of `other`; a Python number becomes a constant, rounded to this format."""
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
        """The same value, under the name `hint` in the C code. It must be the newest value of its
        block, otherwise AssertionError.
        """
        return Real(self.tracer, self.tracer.rename(self.operand, hint))


def real_constant(value: float, format: Format) -> Constant:
    """A constant with the value rounded to the format, so that numpy and the C compiler use the
    same number.
    """
    # through the format: 0.1 is another number in single precision, and C is to read that one
    return Constant(ValueKind.REAL, float(format.dtype.type(value)))


def symbolic(tracer: Tracer, target: Local) -> Value:
    """The local variable `target` as a `Real`, `Truth` or `Unsigned`, by its kind; operations on it
    are recorded by `tracer`.
    """
    match target.kind:
        case ValueKind.REAL:
            return Real(tracer, target)
        case ValueKind.TRUTH:
            return Truth(tracer, target)
        case ValueKind.UNSIGNED | ValueKind.WIDE:
            return Unsigned(tracer, target)


def constant(like: Real, value: float) -> Real:
    """A constant with this value, in the format and tracer of `like`."""
    return Real(like.tracer, real_constant(value, like.format))


def integer(like: Value, value: int) -> Unsigned:
    """A 32-bit integer constant in the tracer of `like`."""
    return Unsigned(like.tracer, Constant(ValueKind.UNSIGNED, value))


def square_root(x: Real) -> Real:
    """√x, correctly rounded; NaN below zero."""
    return Real(x.tracer, x.tracer.assign(Unary(Function.SQUARE_ROOT, x.operand), ValueKind.REAL))


def to_unsigned(x: Real, kind: ValueKind = ValueKind.UNSIGNED) -> Unsigned:
    """The integer part of x, as an integer of `kind`: UNSIGNED (32 bits) or WIDE (64 bits).

    The kernel must check that x is in the range of `kind`: the conversion does not check it.
    """
    return Unsigned(x.tracer, x.tracer.assign(Convert(x.operand), kind))


def to_real(n: Unsigned) -> Real:
    """The integer n as a real; kernels convert only integers that the format represents exactly."""
    return Real(n.tracer, n.tracer.assign(Convert(n.operand), ValueKind.REAL))


def to_kind(n: Unsigned, kind: ValueKind) -> Unsigned:
    """The integer n converted to `kind`: extended to 64 bits (WIDE), or its low 32 bits
    (UNSIGNED).
    """
    return Unsigned(n.tracer, n.tracer.assign(Convert(n.operand), kind))


def look_up(table: Table, index: Unsigned) -> Real:
    """The entry of a table of reals at `index`, which must be inside the table."""
    return Real(index.tracer, index.tracer.assign(Lookup(table, index.operand), ValueKind.REAL))


def look_up_word(table: Table, index: Unsigned) -> Unsigned:
    """The entry of a table of 32-bit integers at `index`, which must be inside the table."""
    operand = index.tracer.assign(Lookup(table, index.operand), ValueKind.UNSIGNED)
    return Unsigned(index.tracer, operand)


def select(condition: Truth, then: Real | float, otherwise: Real | float) -> Real:
    """`then` if the condition is true, else `otherwise`; both are computed in any case."""
    tracer = condition.tracer
    first = then if isinstance(then, Real) else Real(tracer, real_constant(then, tracer.format))
    operation = Select(condition.operand, first.operand, first.lift(otherwise))
    return Real(tracer, tracer.assign(operation, ValueKind.REAL))


def select_word(condition: Truth, then: Unsigned, otherwise: Unsigned | int) -> Unsigned:
    """`then` if the condition is true, else `otherwise`: integers of the same kind."""
    operation = Select(condition.operand, then.operand, then.lift(otherwise))
    return Unsigned(condition.tracer, condition.tracer.assign(operation, then.kind))


def branch(
    condition: Truth, then: Callable[[], Real], otherwise: Callable[[], Real], name: str = ""
) -> Real:
    """The value of `then()` if the condition is true, else of `otherwise()`; only this one is
    executed. `name` is the name of the result in the C code.
    """
    return cast(
        Real,
        branch_tuple(condition, lambda: (then(),), lambda: (otherwise(),), (name,))[0],
    )


def branch_tuple(
    condition: Truth,
    then: Callable[[], tuple[Value, ...]],
    otherwise: Callable[[], tuple[Value, ...]],
    names: tuple[str, ...],
) -> tuple[Value, ...]:
    """The values of `then()` if the condition is true, else of `otherwise()`: tuples of the same
    kinds. `names` has one name per value for the C code.
    """
    tracer = condition.tracer
    first = tracer.block(then)
    second = tracer.block(otherwise)
    # both blocks must give values of the same kinds: a target in C has one type
    targets = tuple(
        tracer.new_local(value.kind, name) for value, name in zip(first.values, names, strict=True)
    )
    tracer.append(Branch(targets, condition.operand, first, second))
    return tuple(symbolic(tracer, target) for target in targets)


@dataclass(frozen=True, slots=True)
class Subroutine:
    """A kernel as a Python function: `build` maps one Real per parameter to one value per result.
    `doc` describes it in the C code.
    """

    name: str
    parameters: tuple[str, ...]
    doc: str
    build: Callable[..., tuple[Value, ...]]
    results: tuple[str, ...] = ("result",)

    def __call__(self, *arguments: Real) -> tuple[Value, ...]:
        """Adds a call of this routine to the routine that is being traced, and returns the results
        as symbolic values.
        """
        tracer = arguments[0].tracer
        routine = trace(self, tracer.format)
        kinds = tuple(value.kind for value in routine.body.values)
        targets = tuple(
            tracer.new_local(kind, name) for kind, name in zip(kinds, self.results, strict=True)
        )
        operands = tuple(argument.operand for argument in arguments)
        tracer.append(Call(targets, routine, operands))
        return tuple(symbolic(tracer, target) for target in targets)


def call(subroutine: Subroutine, *arguments: Real) -> Real:
    """Adds a call of a subroutine with a single result, a real, and returns that result."""
    (result,) = subroutine(*arguments)
    assert isinstance(result, Real)
    return result


# cached by kernel and format: a shared routine is traced and written once
@cache
def trace(subroutine: Subroutine, format: Format) -> Routine:
    """Runs `subroutine.build` on symbolic arguments and returns its statements in this format."""
    tracer = Tracer(format)
    parameters = tuple(tracer.new_local(ValueKind.REAL, name) for name in subroutine.parameters)
    arguments = tuple(Real(tracer, parameter) for parameter in parameters)
    body = drop_unused(tracer.block(lambda: subroutine.build(*arguments)))
    return Routine(
        name=subroutine.name,
        doc=subroutine.doc,
        format=format,
        parameters=parameters,
        results=subroutine.results,
        body=body,
    )
