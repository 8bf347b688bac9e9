"""The self-test's arguments tell a kernel from one with another last digit in a constant."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.c.selftest.selftest_text import kernel_cases
from benchmarks.kernel_accuracy.changed_constants import changed_constants
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.table import routine
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.run_routine import run_routine
from compiler.kernels.trace.statements import Routine

Array = NDArray[Any]
KERNELS = sorted({row.kernel for row in SCALAR_FUNCTIONS.values() if row.kernel})

_EVERY = 7
"""Changes from one that is tried to the next, for time's sake."""


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("real", FORMATS)
def test_what_arguments_at_random_show_the_chosen_ones_show(name: str, real: RealName) -> None:
    right = routine(name, real)
    dtype = right.format.dtype
    cases = kernel_cases([name], "float32" if real == "float" else "float64")[name]
    chosen = np.array([arguments for arguments, _ in cases], dtype).T
    random = np.random.default_rng(11)
    drawn = np.exp2(random.uniform(-12.0, 4.0, (len(chosen), 64))).astype(dtype)
    drawn *= random.choice([-1.0, 1.0], drawn.shape).astype(dtype)
    told = 0
    for site, changed in islice(changed_constants(right), 0, None, _EVERY):
        if _differs(right, changed, chosen):
            told += 1
        else:
            assert not _differs(right, changed, drawn), site
    assert told


def _differs(right: Routine, changed: Routine, points: Array) -> bool:
    (expected,) = run_routine(right, tuple(points))
    (given,) = run_routine(changed, tuple(points))
    other = (given != expected) | (np.signbit(given) != np.signbit(expected))
    return bool((other & ~(np.isnan(given) & np.isnan(expected))).any())
