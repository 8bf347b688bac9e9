"""Evaluates a kernel on numpy arrays, in float32 or float64."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.run_routine import run_routine
from compiler.kernels.trace.statements import Routine
from compiler.kernels.trace.subroutine import trace


def evaluate(name: str, *arrays: NDArray[Any]) -> NDArray[Any]:
    """Evaluates the kernel on arrays of one dtype, float32 or float64, broadcast together.

    float32 gives the bits of the generated C, except for the payload of NaN. Overflow, underflow
    and invalid arguments are silent, as in C. Raises TypeError for other dtypes and KeyError for a
    name that is not in `KERNELS`.

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
    """The statements of a kernel in one format, for code generators."""
    return trace(KERNELS[name].subroutine, FORMATS[real])
