"""Lists the kernels by name, with the accuracy that docs/kernels.md shows to hold."""

from __future__ import annotations

from dataclasses import dataclass

from compiler.kernels.routines.exponential import EXP
from compiler.kernels.routines.hyperbolic import COSH, SINH, TANH
from compiler.kernels.routines.inverse_trigonometric import ACOS, ASIN, ATAN, ATAN2
from compiler.kernels.routines.logarithm import LOG
from compiler.kernels.routines.logistic import SIGMOID, SOFTPLUS
from compiler.kernels.routines.power import POW
from compiler.kernels.routines.trigonometric import COS, SIN, TAN
from compiler.kernels.trace.operations import square_root
from compiler.kernels.trace.subroutine import Subroutine
from compiler.kernels.trace.values import Real, Value


def _sqrt(x: Real) -> tuple[Value, ...]:
    return (square_root(x),)


SQRT = Subroutine("sqrt", ("x",), "Square root, correctly rounded.", _sqrt)


@dataclass(frozen=True, slots=True)
class MathKernel:
    """A scalar function of reals; `error` is the maximum of |value − exact| in ulp."""

    name: str
    arity: int
    parameters: tuple[str, ...]
    doc: str
    domain: str
    error: float
    subroutine: Subroutine


def _kernel(subroutine: Subroutine, domain: str, error: float) -> MathKernel:
    parameters = subroutine.parameters
    return MathKernel(
        name=subroutine.name,
        arity=len(parameters),
        parameters=parameters,
        doc=subroutine.doc,
        domain=domain,
        error=error,
        subroutine=subroutine,
    )


_ALL = "all numbers"
_ROWS = (
    _kernel(EXP, _ALL, 1.0),
    _kernel(LOG, "x ≥ 0; NaN below", 1.0),
    _kernel(SQRT, "x ≥ 0; NaN below", 0.5),
    _kernel(SIN, "all finite numbers; NaN for ±∞", 1.0),
    _kernel(COS, "all finite numbers; NaN for ±∞", 1.0),
    _kernel(TAN, "all finite numbers; NaN for ±∞", 1.0),
    _kernel(ASIN, "−1 … 1; NaN outside", 1.0),
    _kernel(ACOS, "−1 … 1; NaN outside", 1.0),
    _kernel(ATAN, _ALL, 1.0),
    _kernel(ATAN2, _ALL, 2.0),
    _kernel(SINH, _ALL, 1.0),
    _kernel(COSH, _ALL, 1.0),
    _kernel(TANH, _ALL, 1.0),
    _kernel(SIGMOID, _ALL, 1.0),
    _kernel(SOFTPLUS, _ALL, 1.0),
    _kernel(POW, "as C's pow: NaN for a negative x and a y that is no integer", 2.0),
)

KERNELS: dict[str, MathKernel] = {row.name: row for row in _ROWS}
