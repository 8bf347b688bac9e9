"""Which C compiler is found: CC, one on the path, else the one that Python brings as a wheel."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from backends.files.c_compiler import CompilerMissingError, find_compiler
from backends.native.kernel import Kernel
from tests.language.compiled import compiled
from tests.native.test_kernel import FIR, flat, initial, log_of


def without_system_compilers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "/nowhere")


def test_cc_is_obeyed_with_its_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "env gcc -m64")
    assert find_compiler() == ("env", "gcc", "-m64")


def test_without_a_compiler_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler-here")
    with pytest.raises(CompilerMissingError, match="CC"):
        find_compiler()
    without_system_compilers(monkeypatch)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(
        CompilerMissingError, match="install gcc, clang or the Python package ziglang"
    ):
        find_compiler()


@pytest.mark.parametrize("words", ["gcc 'a", "gcc \\"])
def test_a_cc_that_no_shell_reads_is_no_compiler(
    monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.setenv("CC", words)
    with pytest.raises(CompilerMissingError, match="`CC` cannot be split into words"):
        find_compiler()


def test_kernels_of_the_wheel_are_files_of_their_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs the wheel of zig: pip install ziglang")
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path))
    program = compiled(FIR)
    log, t0 = log_of(program), np.arange(10, 31)
    weights = flat(program, initial(program))
    found: list[np.ndarray] = []
    for _ in range(2):
        kernel = Kernel(program, "float64")
        groups = kernel.groups(t0, np.full(len(t0), 4))
        found.append(kernel.losses(kernel.data(log), groups, weights, [1.0]).gradient)
        without_system_compilers(monkeypatch)
    program, *words = find_compiler()
    assert (Path(program).name, words) == ("zig", ["cc"])
    assert len(list(tmp_path.glob("*.so"))) == 2
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
