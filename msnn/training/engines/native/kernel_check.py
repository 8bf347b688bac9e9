"""Compares a freshly built kernel with the interpreter, so that no wrong slope trains silently."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backends.native.kernel import Kernel, by_parameter, flat
from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum, loss_sums

LONGEST = 32
"""Steps of the rollouts that are compared; the interpreter is slow."""

MEMBERS = 8

_DOUBLE = np.dtype(np.float64)

_TOLERANCE = {"float32": (1e-4, 5e-2), "float64": (1e-10, 1e-3)}
"""Of losses, and of slopes along the gradient against differences of the interpreter's losses: far
above rounding and far below what a wrong derivative makes."""


class WrongKernelError(Exception):
    """A kernel's losses or slopes are not those of the program: a bug of msnn."""


def check_kernel(
    kernel: Kernel,
    series: Mapping[str, FloatArray],
    skip: int,
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> None:
    """Losses of a few rollouts, and their slope along the gradient, against the interpreter.

    Raises WrongKernelError. Values that are not finite prove nothing; training reports those.
    """
    steps = np.minimum(runs.steps[:MEMBERS], max(LONGEST, skip + 1))
    few = Runs(runs.t0[:MEMBERS], np.full_like(steps, steps.min()), 0, runs.longest)
    program = kernel.program
    physical = flat(program, weights)
    one = [1.0] * len(kernel.source.losses)
    groups = kernel.groups(few.t0, few.steps)
    found = kernel.losses(kernel.data(series, skip), groups, physical, one)
    measures = {loss.name: loss.measure for loss in program.losses}

    def total(sums: Mapping[str, LossSum]) -> float:
        return sum(value.value(measures[name]) for name, value in sums.items())

    def judged(values: FloatArray, dtype: np.dtype[Any] = _DOUBLE) -> float:
        interpreter = Interpreter(program, by_parameter(program, values), dtype)
        return total(loss_sums(interpreter, series, few, skip))

    pairs = zip(found.sums.tolist(), found.counts.astype(int).tolist(), strict=True)
    named = zip(kernel.source.losses, pairs, strict=True)
    value, expected = total({name: LossSum(*pair) for name, pair in named}), judged(physical)
    most = 1e-6 * float(np.finfo(kernel.dtype).max)  # sums of squares grow beyond the losses
    if not np.isfinite(value) and not judged(physical, kernel.dtype) < most:
        return
    loss_tolerance, slope_tolerance = _TOLERANCE[kernel.dtype.name]
    if np.isfinite(expected) and abs(value - expected) > loss_tolerance * abs(expected) + 1e-12:
        message = f"a training kernel computes the loss {value:.9g} instead of {expected:.9g}"
        raise WrongKernelError(message)
    length = float(np.linalg.norm(found.gradient))
    # A step that changes the loss by 1e-4 of it: little enough to be straight, far above rounding.
    reach = min(1e-4 * abs(expected) / length, float(np.linalg.norm(physical))) if length else 0.0
    if not np.isfinite(length) or length * reach <= 1e-9 * abs(expected):
        return
    step = reach * found.gradient / length
    slope = (judged(physical + step) - judged(physical - step)) / (2 * np.linalg.norm(step))
    if np.isfinite(slope) and abs(slope - length) > slope_tolerance * max(length, abs(slope)):
        message = f"a training kernel computes the slope {length:.6g} instead of {slope:.6g}"
        raise WrongKernelError(message)
