"""How hard compilers and searches try in a test: as for users where that is looked at."""

from __future__ import annotations

from pathlib import Path

from backends.c.host import build
from backends.c.selftest import selftest_text
from backends.c.selftest.singles import golden_singles
from backends.fmu import binary
from backends.native import compile_kernel

TESTS = Path(__file__).parent

QUICK = (
    "agreement",
    "api",
    "cli",
    "examples",
    "exports/test_a2l.py",
    "exports/test_casadi_kinks.py",
    "exports/test_check.py",
    "exports/test_delay.py",
    "exports/test_fmu.py",
    "exports/test_ros2.py",
    "exports/test_unit_states.py",
    "exports/test_zero_slices.py",
    "features/comparison",
    "features/control",
    "features/robots",
    "language",
    "simulation",
    "training",
    "validation",
)
"""Rooms and files that look at what models compute, which levels of optimisation leave as it is to
the bit (tests/native/test_reproducible_bits.py, tests/backends/c/test_bits.py), and not at the test
program that exported C brings along: to search its steps takes longer than the rest of an export,
and its golden steps are half of that.
"""

AS_FOR_USERS = (
    "training/engines/test_gallery_parity.py",
    "features/control/test_gallery.py",
)
"""Files in these rooms that have the flags and searches of the product all the same."""

_UNITS, _LANES, _FAST = binary.FLAGS, compile_kernel.LANES_BY_GCC, compile_kernel.FAST
_LEVEL, _LARGEST = build.LEVEL, golden_singles._LARGEST
_STEPS = selftest_text._TEST_STEPS
_LEAST = ("-O0",)
_FEW_STEPS = 6
"""More than the second instance of the test program lags behind, and more than there are kinds of
invalid samples."""


def is_quick(file: str) -> bool:
    """Whether tests of a file, by its path below `tests`, look at no more than what is computed."""
    listed = any(file == place or file.startswith(f"{place}/") for place in QUICK)
    return listed and file not in AS_FOR_USERS


def set_effort(test: Path) -> None:
    """Prepares this process for a test of a file."""
    quick = is_quick(test.relative_to(TESTS).as_posix())
    compile_kernel.LANES_BY_GCC = _LEAST if quick else _LANES
    compile_kernel.FAST = _LEAST if quick else _FAST
    build.LEVEL = "-O0" if quick else _LEVEL
    binary.FLAGS = tuple("-O0" if quick and flag == "-O2" else flag for flag in _UNITS)
    golden_singles._LARGEST = 0 if quick else _LARGEST
    selftest_text._TEST_STEPS = _FEW_STEPS if quick else _STEPS
