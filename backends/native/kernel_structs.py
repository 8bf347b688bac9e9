"""ctypes definitions of structs and arrays of a kernel's C code."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ALIGNMENT = 64
"""Size in bytes of the widest vector."""


class ProblemStruct(ctypes.Structure):
    """The data of a kernel call: series, scored rows, skipped steps.

    `struct problem` of templates/native/driver.c.
    """

    # ctypes uses the platform's ABI: order and widths must agree with the C code
    _fields_ = (
        ("series", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("scored", ctypes.c_void_p),
        ("skip", ctypes.c_int64),
    )


class VariablesStruct(ctypes.Structure):
    """The parameters of an optimiser: raw and physical values, bounds, learning rates, moments.

    `struct variables` of templates/native/variables.c.
    """

    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("kind", "low", "high", "scale", "rate", "raw", "physical", "first", "second")
    )


class KnownStruct(ctypes.Structure):
    """The priors of parameters, and the penalties on their magnitudes and norms.

    `struct known` of templates/native/known.c.
    """

    _fields_ = (
        ("mean", ctypes.c_void_p),
        ("std", ctypes.c_void_p),
        ("magnitude", ctypes.c_void_p),
        ("numbers", ctypes.c_void_p),
        ("bounds", ctypes.c_void_p),
        ("norms", ctypes.c_void_p),
        ("slices", ctypes.c_int64),
        ("spread", ctypes.c_double),
    )


class CurvatureStruct(ctypes.Structure):
    """The memory of L-BFGS: the latest pairs of a step and its change of the gradient.

    `struct curvature` of templates/native/lbfgs.c.
    """

    _fields_ = (
        ("history", ctypes.c_int32),
        ("iterations", ctypes.c_int32),
        ("looks", ctypes.c_int32),
        ("pairs", ctypes.c_int32),
        ("newest", ctypes.c_int32),
        ("steps", ctypes.c_void_p),
        ("changes", ctypes.c_void_p),
        ("shares", ctypes.c_void_p),
        ("along", ctypes.c_void_p),
        ("work", ctypes.c_void_p),
    )


class OptimizerStruct(ctypes.Structure):
    """The method, settings and step counts of an optimiser.

    `struct optimizer` of templates/native/optimizers.c.
    """

    _fields_ = (
        ("method", ctypes.c_int32),
        ("missing", ctypes.c_int32),
        ("beta1", ctypes.c_double),
        ("beta2", ctypes.c_double),
        ("epsilon", ctypes.c_double),
        ("decay", ctypes.c_double),
        ("clip", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("first_decay", ctypes.c_double),
        ("second_decay", ctypes.c_double),
        ("left_out", ctypes.c_int64),
        ("known", ctypes.POINTER(KnownStruct)),
        ("curvature", ctypes.POINTER(CurvatureStruct)),
    )


class WorkStruct(ctypes.Structure):
    """The working memory of a call, its threads, and its rank among processes.

    `struct work` of templates/native/batches.c.
    """

    _fields_ = (
        ("memory", ctypes.c_void_p),
        ("steps", ctypes.c_int64),
        ("groups", ctypes.c_int64),
        ("kept", ctypes.c_int32),
        ("threads", ctypes.c_int32),
        ("rank", ctypes.c_int32),
        ("ranks", ctypes.c_int32),
        ("hand_on", ctypes.c_void_p),
    )


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """The address of the first element; the array must outlive its use."""
    return ctypes.c_void_p(array.ctypes.data)


def pointers(arrays: Sequence[NDArray[Any]]) -> ctypes.Array[ctypes.c_void_p]:
    """The addresses of several arrays, as a C array."""
    # at least one: C has no empty arrays
    return (ctypes.c_void_p * max(len(arrays), 1))(*(array.ctypes.data for array in arrays))


def aligned(size: int) -> NDArray[np.uint8]:
    """`size` bytes, aligned for vectors."""
    raw = np.zeros(size + _ALIGNMENT, np.uint8)
    # numpy aligns to 16 bytes only: vector loads would fault or be slow
    offset = -raw.ctypes.data % _ALIGNMENT
    # the view keeps the whole array alive
    return raw[offset : offset + size]
