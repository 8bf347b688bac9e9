"""Operations on symbolic values in addition to arithmetic and comparison."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from compiler.kernels.trace.statements import (
    Branch,
    Constant,
    Convert,
    Function,
    Lookup,
    Select,
    Table,
    Unary,
    ValueKind,
)
from compiler.kernels.trace.values import Real, Truth, Unsigned, Value, real_constant, symbolic


def constant(like: Real, value: float) -> Real:
    """A constant in the format of `like`."""
    return Real(like.tracer, real_constant(value, like.format))


def integer(like: Value, value: int) -> Unsigned:
    """A 32-bit integer constant."""
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
    """The integer as a real; kernels convert only integers that the format represents exactly."""
    return Real(n.tracer, n.tracer.assign(Convert(n.operand), ValueKind.REAL))


def to_kind(n: Unsigned, kind: ValueKind) -> Unsigned:
    """The integer extended to 64 bits, or its low 32 bits."""
    return Unsigned(n.tracer, n.tracer.assign(Convert(n.operand), kind))


def look_up(table: Table, index: Unsigned) -> Real:
    """An entry of a table of reals."""
    return Real(index.tracer, index.tracer.assign(Lookup(table, index.operand), ValueKind.REAL))


def look_up_word(table: Table, index: Unsigned) -> Unsigned:
    """An entry of a table of 32-bit integers."""
    operand = index.tracer.assign(Lookup(table, index.operand), ValueKind.UNSIGNED)
    return Unsigned(index.tracer, operand)


def select(condition: Truth, then: Real | float, otherwise: Real | float) -> Real:
    """One of two values; both are computed."""
    tracer = condition.tracer
    first = then if isinstance(then, Real) else Real(tracer, real_constant(then, tracer.format))
    operation = Select(condition.operand, first.operand, first.lift(otherwise))
    return Real(tracer, tracer.assign(operation, ValueKind.REAL))


def select_word(condition: Truth, then: Unsigned, otherwise: Unsigned | int) -> Unsigned:
    """One of two integers of the same kind."""
    operation = Select(condition.operand, then.operand, then.lift(otherwise))
    return Unsigned(condition.tracer, condition.tracer.assign(operation, then.kind))


def branch(
    condition: Truth, then: Callable[[], Real], otherwise: Callable[[], Real], name: str = ""
) -> Real:
    """The value of one of two computations; only that one is executed."""
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
    """Like `branch`, for several values, with one name each."""
    tracer = condition.tracer
    first = tracer.block(then)
    second = tracer.block(otherwise)
    # both blocks must give values of the same kinds: a target in C has one type
    targets = tuple(
        tracer.new_local(value.kind, name) for value, name in zip(first.values, names, strict=True)
    )
    tracer.append(Branch(targets, condition.operand, first, second))
    return tuple(symbolic(tracer, target) for target in targets)
