"""The table of `tests/effort.py`: of rooms and files that are there, and heeded."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest

from backends.c.host import build
from backends.c.selftest import selftest_text
from backends.c.selftest.singles import golden_singles
from backends.fmu import binary
from backends.native import compile_kernel
from tests.effort import AS_FOR_USERS, QUICK, TESTS, set_effort

HERE = Path(__file__)


@pytest.fixture(autouse=True)
def _put_back() -> Generator[None]:
    yield
    set_effort(HERE)


def test_it_names_what_is_there() -> None:
    assert [place for place in QUICK if not (TESTS / place).exists()] == []
    assert [file for file in AS_FOR_USERS if not (TESTS / file).is_file()] == []
    assert [file for file in AS_FOR_USERS if not file.startswith(QUICK)] == []


@pytest.mark.parametrize("file", ["native/test_kernel.py", *AS_FOR_USERS])
def test_what_is_not_quick_has_the_flags_and_searches_of_users(file: str) -> None:
    set_effort(TESTS / "cli" / "test_workflow.py")
    assert compile_kernel.kernel_flags(("gcc",), on_lanes=True)[0] == "-O0"
    assert compile_kernel.kernel_flags(("gcc",), on_lanes=False)[0] == "-O0"
    assert "-O0" in binary.FLAGS
    assert build.LEVEL == "-O0"
    assert golden_singles._LARGEST == 0
    assert selftest_text._TEST_STEPS == 6
    set_effort(TESTS / file)
    assert "-ftree-vectorize" in compile_kernel.kernel_flags(("gcc",), on_lanes=True)
    assert compile_kernel.kernel_flags(("gcc",), on_lanes=False)[0] == "-O3"
    assert "-O2" in binary.FLAGS
    assert build.LEVEL == "-O2"
    assert golden_singles._LARGEST > 0
    assert selftest_text._TEST_STEPS == 16
