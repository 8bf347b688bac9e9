"""Test arguments of each kernel for the self-test, with the exact results."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from backends.c_language.literals import Dtype
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.branch_cover import branch_cover
from compiler.kernels.table import evaluate
from compiler.kernels.tables.formats import RealName
from compiler.kernels.tables.telling_arguments import telling_arguments

Case = tuple[tuple[float, ...], float]

_PLACES = (0.03, 0.37, 0.81)
"""Relative positions in the domain."""


def kernel_cases(kernels: Iterable[str], dtype: Dtype) -> dict[str, list[Case]]:
    """For each kernel, arguments on every branch and those sensitive to each constant, with
    results.
    """
    real = "float" if dtype == "float32" else "double"
    cases: dict[str, list[Case]] = {}
    # sorted, so that the file is deterministic
    for kernel in sorted(kernels):
        plain = plain_points(kernel, real)
        points = np.array([*plain, *telling_arguments(kernel, real, len(plain[0]))], dtype)
        values = evaluate(kernel, *points.T)
        cases[kernel] = [
            (tuple(float(x) for x in point), float(value))
            for point, value in zip(points, values, strict=True)
        ]
    return cases


def plain_points(kernel: str, real: RealName) -> list[tuple[float, ...]]:
    """Arguments within the domain of a kernel and on every branch."""
    domains = {row.kernel: row.domain for row in SCALAR_FUNCTIONS.values() if row.kernel}
    axes = [[low + (high - low) * place for place in _PLACES] for low, high in domains[kernel]]
    return [*product(*axes), *branch_cover(kernel, real)]
