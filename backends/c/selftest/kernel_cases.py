"""Arguments at which the self-test looks at each kernel, with the bits that it must give."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from backends.c_language.literals import Dtype
from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from compiler.kernels.branch_cover import branch_cover
from compiler.kernels.evaluate import evaluate

Case = tuple[tuple[float, ...], float]

_PLACES = (0.03, 0.37, 0.81)
"""Where in the domain: irrational enough that every coefficient matters."""


def kernel_cases(kernels: Iterable[str], dtype: Dtype) -> dict[str, list[Case]]:
    """For each kernel arguments within its domain and on every branch, and its value there."""
    domains = {row.kernel: row.domain for row in SCALAR_FUNCTIONS.values() if row.kernel}
    cases: dict[str, list[Case]] = {}
    for kernel in sorted(kernels):
        axes = [[low + (high - low) * place for place in _PLACES] for low, high in domains[kernel]]
        cover = branch_cover(kernel, "float" if dtype == "float32" else "double")
        points = np.array([*product(*axes), *cover], dtype)
        values = evaluate(kernel, *points.T)
        cases[kernel] = [
            (tuple(float(x) for x in point), float(value))
            for point, value in zip(points, values, strict=True)
        ]
    return cases
