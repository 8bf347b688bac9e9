"""Connects the Python text of a kernel with its traced routine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.drop_unused import drop_unused
from compiler.kernels.trace.statements import Call, Routine, ValueKind
from compiler.kernels.trace.values import Real, Tracer, Value, symbolic


@dataclass(frozen=True, slots=True)
class Subroutine:
    """The Python text of a kernel; `build` maps one Real per parameter to one value per result."""

    name: str
    parameters: tuple[str, ...]
    doc: str
    build: Callable[..., tuple[Value, ...]]
    results: tuple[str, ...] = ("result",)

    def __call__(self, *arguments: Real) -> tuple[Value, ...]:
        """Records a call of this routine by the routine that is being traced."""
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
    """Calls a routine with a single real result."""
    (result,) = subroutine(*arguments)
    assert isinstance(result, Real)
    return result


# cached by kernel and format: a shared routine is traced and written once
@cache
def trace(subroutine: Subroutine, format: Format) -> Routine:
    """The statements of a kernel in one format."""
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
