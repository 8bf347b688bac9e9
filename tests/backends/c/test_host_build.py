"""What a compiler refuses, and the checks of the numpy door."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.host.build import CompilerFailedError, build_library, build_test
from tests.backends.c.c_programs import built, closed_sample


def test_what_the_compiler_says_is_shown(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "bad.c").write_text("int x = ;")
    with pytest.raises(CompilerFailedError, match=r"bad\.c"):
        build_library(tmp_path, tmp_path / "bad.so")


def test_the_test_program_is_built_too(tmp_path: Path) -> None:
    built(closed_sample("fir_closed_loop"), tmp_path, COptions())
    assert build_test(tmp_path, tmp_path / "program").stat().st_size > 0


def test_values_are_checked_before_they_reach_c(tmp_path: Path) -> None:
    step = built(closed_sample("joint_arm"), tmp_path, COptions())
    with pytest.raises(ValueError, match="tau"):
        step.step({})
    with pytest.raises(ValueError, match="shape"):
        step.step({"tau": np.zeros(4)})
    with pytest.raises(ValueError, match="values wanted"):
        step.reset({"nothing": 0.0})


def test_a_compiler_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "hangs"
    compiler.write_text("#!/bin/sh\nsleep 1000\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("MSNN_COMPILER_SECONDS", "0.2")
    with pytest.raises(CompilerFailedError, match=r"it did not end within 0\.2 s"):
        build_library(tmp_path, tmp_path / "never.so", (str(compiler),))
