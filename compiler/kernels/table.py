"""Lists the math kernels with their error bounds, which docs/kernels.md confirms by measurement,
and evaluates them on numpy arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.routines.exponential import EXP, LOG, SIGMOID, SOFTPLUS
from compiler.kernels.routines.hyperbolic import COSH, SINH, TANH
from compiler.kernels.routines.inverse_trigonometric import ACOS, ASIN, ATAN, ATAN2
from compiler.kernels.routines.power import POW
from compiler.kernels.routines.trigonometric import COS, SIN, TAN
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.run_routine import run_routine
from compiler.kernels.trace.statements import Routine
from compiler.kernels.trace.values import Real, Subroutine, Value, square_root, trace


def _sqrt(x: Real) -> tuple[Value, ...]:
    return (square_root(x),)


SQRT = Subroutine("sqrt", ("x",), "Square root, correctly rounded.", _sqrt)


@dataclass(frozen=True, slots=True)
class MathKernel:
    """A math kernel: a scalar function of one or two reals. `error` is the maximum of |value −
    exact| in ulp, `domain` describes the arguments in words.
    """

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


def evaluate(name: str, *arrays: NDArray[Any]) -> NDArray[Any]:
    """Evaluates the kernel on arrays of one dtype, float32 or float64, broadcast together.

    float32 gives the bits of the generated C, except for the payload of NaN. Overflow, underflow
    and invalid arguments are silent, as in C. Raises TypeError for other dtypes or a wrong number
    of arrays, and KeyError for a name that is not in `KERNELS`.

        >>> evaluate("tanh", np.array([0.0, 30.0], dtype=np.float32))
        array([0., 1.], dtype=float32)
    """
    inputs = [np.asarray(array) for array in arrays]
    dtypes = {array.dtype for array in inputs}
    formats = [row for row in FORMATS.values() if {row.dtype} == dtypes]
    if len(formats) != 1:
        found = ", ".join(sorted(str(dtype) for dtype in dtypes))
        raise TypeError(f"{name} takes arrays of float32 or of float64, not {found}")
    shape = np.broadcast_shapes(*(array.shape for array in inputs))
    flat = tuple(np.broadcast_to(array, shape).reshape(-1) for array in inputs)
    if len(flat) != KERNELS[name].arity:
        raise TypeError(f"{name} takes {KERNELS[name].arity} arguments, not {len(flat)}")
    (result,) = run_routine(routine(name, formats[0].c_type), flat)
    return np.broadcast_to(result, flat[0].shape).reshape(shape)


def routine(name: str, real: RealName) -> Routine:
    """The statements of the kernel `name` in the format `real`, for code generators. Raises
    KeyError for an unknown name.
    """
    return trace(KERNELS[name].subroutine, FORMATS[real])
