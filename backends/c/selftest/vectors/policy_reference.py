"""Applies input policies in NumPy: the reference for the checks in generated C."""

from __future__ import annotations

from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits, stand_in
from backends.c.interface.status import StatusBit
from backends.c_language.literals import Dtype
from compiler.ir.program import Signal

Array = NDArray[Any]


def apply_policy(
    signal: Signal, values: Array, previous: Array, dtype: Dtype
) -> tuple[Array, StatusBit]:
    """The values of an input after its policy, and the status bits that the policy sets.

    `previous` are the values used in the previous step; all arrays have the type `dtype`.
    """
    low, high, valid = _judged(signal, values, dtype)
    if signal.on_invalid == "trust" or bool(np.all(valid)):
        return values, StatusBit(0)
    not_a_number = StatusBit.NOT_A_NUMBER if bool(np.any(np.isnan(values))) else StatusBit(0)
    match signal.on_invalid:
        case "flag":
            outside = bool(np.any((values < low) | (values > high)))
            return values, not_a_number | (StatusBit.OUT_OF_RANGE if outside else StatusBit(0))
        case "clamp":
            instead = np.dtype(dtype).type(stand_in(signal, dtype))
            # NaN is on neither side: the stand-in takes its place
            nearest = np.where(values > high, high, np.where(values < low, low, instead))
            return np.where(valid, values, nearest), not_a_number | StatusBit.CLAMPED
        case "hold":
            return np.where(valid, values, previous), not_a_number | StatusBit.HELD
        case _:
            assert_never(signal.on_invalid)


def apply_policy_to_window(signal: Signal, rows: Array, dtype: Dtype) -> tuple[Array, StatusBit]:
    """The samples (time, *shape) of a window after the policy, and the status bits.

    Each sample can fall back to the previous one.
    """
    checked, bits = rows.copy(), StatusBit(0)
    before = first_held(signal, rows.shape[1:], dtype)
    for k in range(len(rows)):
        before, said = apply_policy(signal, rows[k], before, dtype)
        checked[k], bits = before, bits | said
    return checked, bits


def invalid_samples(signal: Signal, series: Array, dtype: Dtype) -> NDArray[np.bool_]:
    """True for the samples (runs, steps, *shape) with an element outside the limits or NaN."""
    _, _, valid = _judged(signal, series, dtype)
    return ~np.asarray(valid.all(axis=tuple(range(2, series.ndim))))


def _judged(signal: Signal, values: Array, dtype: Dtype) -> tuple[Any, Any, NDArray[np.bool_]]:
    """The lower and upper limit, and the mask of elements within them."""
    low, high = (np.dtype(dtype).type(limit) for limit in limits(signal, dtype))
    # false for NaN
    return low, high, (values >= low) & (values <= high)


def first_held(signal: Signal, shape: tuple[int, ...], dtype: Dtype) -> Array:
    """The value that `hold` uses before the first valid value."""
    return np.full(shape, stand_in(signal, dtype), dtype)
