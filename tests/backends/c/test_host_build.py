"""What a compiler refuses, and the checks of the numpy door."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.host import build
from backends.c.host.build import CompilerFailedError, build_library
from backends.files.c_compiler import Finished, run_compiler
from tests.backends.c.c_programs import built, closed_sample
from tests.full_disk import full_after


def test_what_the_compiler_says_is_shown(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "bad.c").write_text("int x = ;")
    with pytest.raises(CompilerFailedError, match=r"bad\.c"):
        build_library(tmp_path, tmp_path / "bad.so")


def test_a_compiler_whose_words_a_full_disk_has_lost_is_not_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it says is kept beside what it makes: neither fits."""
    silent = tmp_path / "silent"
    silent.write_text("#!/bin/sh\necho 'collect2: error: ld returned 1 exit status' >&2; exit 1\n")
    silent.chmod(0o700)
    with pytest.raises(CompilerFailedError) as caught:
        build.compiled([str(silent)], tmp_path / "it.o")
    assert caught.value.said == ["collect2: error: ld returned 1 exit status"]
    with full_after(1000), pytest.raises(OSError, match="too large") as full:
        build.compiled([str(silent)], tmp_path / "it.o")
    assert full.value.filename == str(tmp_path)


def test_a_header_that_changed_is_seen(tmp_path: Path) -> None:
    """What is compiled once is a text with all that it includes, not a name."""
    (tmp_path / "src").mkdir()
    (tmp_path / "include").mkdir()
    (tmp_path / "src" / "it.c").write_text('#include "outer.h"\nint it(void) { return IT; }\n')
    # as exported C has them: a header beside the sources sends to its namesake
    (tmp_path / "src" / "outer.h").write_text('#include "../include/outer.h"\n')
    (tmp_path / "include" / "outer.h").write_text('#include "inner.h"\n')
    found: list[int] = []
    for number in (1, 2, 1):
        (tmp_path / "include" / "inner.h").write_text(f"#define IT {number}\n")
        library = build_library(tmp_path, tmp_path / f"{len(found)}.so")
        found.append(ctypes.CDLL(str(library)).it())
    assert found == [1, 2, 1]


def test_a_file_is_compiled_once_for_each_compiler_and_its_flags(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[Sequence[str]] = []

    def counted(command: Sequence[str]) -> Finished:
        compiled.extend([command] if "-c" in command else [])
        return run_compiler(command)

    monkeypatch.setattr(build, "run_compiler", counted)
    for name in ("one", "other"):
        (tmp_path / name / "src").mkdir(parents=True)
        (tmp_path / name / "src" / "own.c").write_text("int once(void) { return 7; }\n")
        for compiler, level in (("gcc", "-O0"), ("gcc", "-O1"), ("clang", "-O0")):
            build_library(tmp_path / name, tmp_path / "own.so", [compiler], [level])
    assert [(command[0], command[2]) for command in compiled] == [
        ("gcc", "-O0"),
        ("gcc", "-O1"),
        ("clang", "-O0"),
    ]


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
