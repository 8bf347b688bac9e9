"""Golden vectors as C: functions that hold them, feed the step with them and compare results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.c_language import (
    Argument,
    Assign,
    Binary,
    Call,
    CType,
    Declare,
    Discard,
    Element,
    Function,
    If,
    Member,
    Name,
    Real,
    Return,
    Statement,
    Table,
    Truth,
    Unary,
    Unsigned,
)
from backends.c.golden_vectors import GoldenVectors, joined
from backends.c.helper_functions import is_nan
from backends.c.interface import Field, Interface
from backends.c.places import Index, Place, variable
from backends.c.scope import LocalNames, Scope
from backends.c.structs import RESERVED
from backends.c.values import copy_value

Array = NDArray[Any]
_STEP, _RUN = "step", "run"


def golden_functions(interface: Interface, runs: Sequence[GoldenVectors]) -> tuple[Function, ...]:
    """`<prefix>_load_start(x0, run)`, `_load_inputs(u, step)`, `_results_differ(status, y, step)`.

    Steps are counted through all runs.
    """
    prefix = interface.prefix
    golden = joined(runs)
    starts = [(f, np.stack([run.windows[f.name] for run in runs])) for f, _ in interface.windows]
    starts += [(f, np.stack([run.supplied[f.name] for run in runs])) for f, _ in interface.supplied]
    inputs = [(input.field, golden.inputs[input.field.name]) for input in interface.inputs]
    outputs = [(field, golden.outputs[field.name]) for field in interface.outputs]
    return (
        *((differs_function(prefix),) if outputs else ()),
        _load_start(interface, starts, len(runs)),
        _load_inputs(interface, inputs, len(golden.status)),
        _comparison(interface, outputs, golden),
    )


def differs_function(prefix: str) -> Function:
    """Whether a number is another one than expected; NaN is NaN, and an infinity itself only."""
    x, expected, tolerance = Name("x"), Name("expected"), Name("tolerance")
    near = Binary(
        "&&",
        Binary("<=", Binary("-", x, expected), tolerance),
        Binary("<=", Binary("-", expected, x), tolerance),
    )
    parts = {
        "within": near,
        "equal": Binary("&&", Binary("<=", x, expected), Binary(">=", x, expected)),
        "both_nan": Binary("&&", is_nan(x), is_nan(expected)),
    }
    fine = Binary("||", Binary("||", Name("within"), Name("equal")), Name("both_nan"))
    body = (
        *(Declare(CType.BOOL, name, value, constant=True) for name, value in parts.items()),
        Return(Unary("!", fine)),
    )
    real = f"{prefix}_real"
    arguments = tuple(Argument(real, name) for name in ("x", "expected", "tolerance"))
    return Function(f"{prefix}_differs", "bool", arguments, body, static=True)


def _table(name: str, fields: Sequence[tuple[Field, Array]], steps: int) -> Table:
    """All fields of a step in one row, the rows one after the other."""
    parts = [values.reshape(steps, field.size) for field, values in fields]
    numbers = np.concatenate(parts, axis=1).ravel().tolist()
    return Table(name, tuple(numbers), hexadecimal=True)


def _row(table: str, fields: Iterable[Field], row: str) -> list[Place]:
    """Where each field stands in the table."""
    listed = list(fields)
    width = sum(field.size for field in listed)
    begin = variable(row).times(width)
    places: list[Place] = []
    for field in listed:
        place = Place.array(Name(table), field.shape)
        places.append(Place(place.storage, place.shape, place.strides, begin))
        begin = begin.plus(Index(field.size))
    return places


def _load_start(interface: Interface, starts: Sequence[tuple[Field, Array]], runs: int) -> Function:
    scope = Scope(LocalNames(interface.prefix))
    if starts:
        scope.add(_table("golden", starts, runs))
    else:
        scope.add(Discard(_RUN))
    return _loader(interface, scope, "start", Argument("init", "x0"), [f for f, _ in starts], _RUN)


def _load_inputs(
    interface: Interface, inputs: Sequence[tuple[Field, Array]], steps: int
) -> Function:
    scope = Scope(LocalNames(interface.prefix))
    if inputs:
        scope.add(_table("golden", inputs, steps))
    else:
        scope.add(Discard(_STEP))
    return _loader(interface, scope, "inputs", Argument("in", "u"), [f for f, _ in inputs], _STEP)


def _loader(
    interface: Interface,
    scope: Scope,
    name: str,
    struct: Argument,
    fields: list[Field],
    row_name: str,
) -> Function:
    """Copies one row of the table `golden` into a struct."""
    prefix = interface.prefix
    if not fields:
        scope.assign(Member(struct.name, RESERVED), Unsigned(0))
    for field, row in zip(fields, _row("golden", fields, row_name), strict=True):
        copy_value(row, field.place(struct.name), scope, interface.options.unroll)
    arguments = [
        Argument(f"{prefix}_{struct.type}_t *", struct.name),
        Argument("uint32_t", row_name),
    ]
    body = tuple(scope.statements)
    return Function(f"{prefix}_load_{name}", "void", tuple(arguments), body, static=True)


def _comparison(
    interface: Interface, outputs: Sequence[tuple[Field, Array]], golden: GoldenVectors
) -> Function:
    prefix = interface.prefix
    scope = Scope(LocalNames(prefix))
    bits = tuple(float(status) for status in golden.status)
    scope.add(Table("golden_status", bits, CType.UNSIGNED))
    if outputs:
        scope.add(_table("golden", outputs, len(bits)))
    else:
        scope.add(Discard("y"))
    expected = Element(Name("golden_status"), Name(_STEP))
    scope.add(Declare(CType.BOOL, "differ", Binary("!=", Name("status"), expected)))
    fields = [field for field, _ in outputs]
    for (field, values), row in zip(outputs, _row("golden", fields, _STEP), strict=True):
        tolerance = Real(_tolerance(interface, values))
        compare = _compared(prefix, field.place("y"), row, tolerance)
        scope.each(field.shape, interface.options.unroll, compare)
    scope.add(Return(Name("differ")))
    arguments = (
        Argument(f"{prefix}_status_t", "status"),
        Argument(f"const {prefix}_out_t *", "y"),
        Argument("uint32_t", _STEP),
    )
    body = tuple(scope.statements)
    return Function(f"{prefix}_results_differ", "bool", arguments, body, static=True)


def _compared(
    prefix: str, given: Place, expected: Place, tolerance: Real
) -> Callable[[tuple[Index, ...], Scope], None]:
    def compare(at: tuple[Index, ...], scope: Scope) -> None:
        arguments = (given.element(at), expected.element(at), tolerance)
        scope.add(If(Call(f"{prefix}_differs", arguments), _DIFFER))

    return compare


_DIFFER: tuple[Statement, ...] = (Assign(Name("differ"), Truth(True)),)


def _tolerance(interface: Interface, values: Array) -> float:
    """0 where the interpreter runs the same kernels in the same precision.

    In float64 it calls numpy's functions and a C library is a third one: last places differ, and
    a run of steps lets the difference grow.
    """
    options = interface.options
    if options.is_exact:
        return 0.0
    finite = np.abs(values[np.isfinite(values)])
    scale = max(1.0, float(finite.max())) if finite.size else 1.0
    return scale * (1e-9 if options.dtype == "float64" else 1e-3)


def kernels_function(
    prefix: str, cases: Mapping[str, Sequence[tuple[tuple[float, ...], float]]]
) -> Function:
    """Whether a kernel gives other bits than it should: arguments and value by kernel."""
    body: list[Statement] = [Declare(CType.BOOL, "differ", Truth(False))]
    for kernel, rows in cases.items():
        for arguments, value in rows:
            called = Call(f"{prefix}_{kernel}", tuple(Real(argument) for argument in arguments))
            check = Call(f"{prefix}_differs", (called, Real(value), Real(0.0)))
            body.append(If(check, _DIFFER))
    body.append(Return(Name("differ")))
    return Function(f"{prefix}_kernels_differ", "bool", (), tuple(body), static=True)
