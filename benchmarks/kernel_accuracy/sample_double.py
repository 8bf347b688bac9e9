"""Measures the double kernels on random arguments against mpmath and writes docs/kernels.md.

    python -m benchmarks.kernel_accuracy.sample_double [--count N] [--only NAME ...]

Run from the top folder; about ten minutes on one core.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

from benchmarks.kernel_accuracy.report import PROMISED_DOUBLE, Measurement, keep, write_report
from compiler.kernels.table import KERNELS, evaluate
from tests.kernels.references import EXACT, double_error

Array = NDArray[Any]

# where results are finite and interesting; others are sampled in every binade
RANGES = {
    "exp": (-745.2, 709.8),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "sinh": (-711.0, 711.0),
    "cosh": (-711.0, 711.0),
    "tanh": (-22.0, 22.0),
    "sigmoid": (-745.2, 45.0),
    "softplus": (-745.2, 745.2),
}


def draw(name: str, count: int) -> tuple[Array, ...]:
    """Columns of `count` arguments: half of usual size, half over the range."""
    random = np.random.default_rng(11)

    def usual() -> Array:
        return random.standard_normal(count // 2) * 10.0 ** random.uniform(-4.0, 3.0, count // 2)

    def wide() -> Array:
        if name in RANGES:
            return random.uniform(*RANGES[name], count // 2)
        bits = random.integers(0, 2**64 - 1, count // 2, np.uint64, endpoint=True)
        return bits.view(np.float64)

    first = np.concatenate([usual(), wide()])
    if name in ("log", "sqrt", "pow"):
        first = np.abs(first)
    if KERNELS[name].arity == 1:
        return (first,)
    if name == "pow":
        # results over the whole range of the format
        with np.errstate(all="ignore"):
            return first, random.uniform(-745.0, 709.7, first.size) / np.log(first)
    return first, np.concatenate([usual(), wide()])


def measure(name: str, count: int) -> Measurement:
    """The measured accuracy of one kernel; arguments without a finite value are omitted."""
    columns = draw(name, count)
    values = evaluate(name, *columns)
    compared, wrong, largest, largest_at = 0, 0, 0.0, [0.0]
    for value, *point in zip(
        values.tolist(), *(column.tolist() for column in columns), strict=True
    ):
        if not all(map(np.isfinite, [value, *point])):
            continue
        # log1p(exp(x)) of a large negative x needs the digits of both
        with mp.workprec(1300 if name == "softplus" else 200):
            exact = EXACT[name](*map(mpf, point))
            if exact == 0 or abs(exact) >= mpf(2) ** 1024:
                continue
            error = double_error(value, exact)
        compared += 1
        wrong += error > 0.5
        if error > largest:
            largest, largest_at = error, point
    return Measurement(compared, largest, largest_at, wrong, 0, [])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="arguments a kernel")
    parser.add_argument("--only", nargs="*", default=[], help="kernels to measure")
    options = parser.parse_args()
    failed = False
    for name in options.only or list(KERNELS):
        row = measure(name, options.count)
        print(name, row, flush=True)
        failed = failed or row.largest_error > PROMISED_DOUBLE
        keep("double", name, row)
        write_report()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
