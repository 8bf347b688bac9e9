"""Building a kernel: compilers that do not work, refused sources, Ctrl-C meanwhile."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from backends.files.c_compiler import CompilerMissingError
from backends.native import compile_kernel
from backends.native.compile_kernel import KernelBuildError, compiled_kernel, kernel_flags
from tests.conditions import require_tool

SLOW = f"""#!{sys.executable}
import sys, time, subprocess, pathlib
if "--version" not in sys.argv:
    pathlib.Path({{started!r}}).touch()
    time.sleep(1)
sys.exit(subprocess.run(["gcc", *sys.argv[1:]]).returncode)
"""

OTHER = f"""#!{sys.executable}
import sys, subprocess
if "--version" in sys.argv:
    print("a compiler 1.0")
    sys.exit(0)
if "-fipa-ra" in sys.argv:
    sys.exit("unknown argument: -fipa-ra")
sys.exit(subprocess.run(["gcc", *sys.argv[1:]]).returncode)
"""


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "cache"))


def test_a_compiler_that_compiles_nothing_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "false")
    with pytest.raises(
        CompilerMissingError, match=r"`false` compiles nothing \(it ended with code 1"
    ):
        compiled_kernel("int f(void) { return 1; }")


def test_a_source_that_is_refused_is_a_bug_of_ours() -> None:
    require_tool("gcc", install="apt install gcc")
    with pytest.raises(KernelBuildError, match="error"):
        compiled_kernel("int f(void) { return }")


def test_a_compiler_that_is_not_gcc_gets_no_flags_of_gcc(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clang refuses -fipa-ra, and makes slow kernels of what gcc makes fast ones of."""
    require_tool("gcc", install="apt install gcc")
    compiler = tmp_path / "gcc"
    compiler.write_text(OTHER)
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    assert "-O1" in kernel_flags(("gcc",), on_lanes=True)
    assert "-O3" in kernel_flags((str(compiler),), on_lanes=True)
    built = compiled_kernel("int f(void) { return 1; }", on_lanes=True)
    assert built.library.f() == 1


def test_all_that_a_kernel_is_made_of_decides_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a kernel of other flags, of the compiler before an update or of another processor, from
    which a shared disk has it, would be loaded."""
    require_tool("gcc", install="apt install gcc")
    compiler, source = tmp_path / "cc", "int f(void) { return 1; }"

    def installed(version: str, path: Path = compiler) -> None:
        path.write_text(OTHER.replace("a compiler 1.0", f"a compiler {version}"))
        path.chmod(0o755)
        monkeypatch.setenv("CC", str(path))

    installed("1.0")
    first = compiled_kernel(source).name
    assert compiled_kernel(source).name == first
    # of the same length
    names = {first, compiled_kernel(source.replace("1", "2")).name}
    monkeypatch.setenv("CC", f"{compiler} -DOTHER")
    names.add(compiled_kernel(source).name)
    # another length: what is asked of a file is kept by its size and time
    installed("1.0.1")
    names.add(compiled_kernel(source).name)
    installed("1.0.1", tmp_path / "another-cc")
    names.add(compiled_kernel(source).name)
    monkeypatch.setattr(compile_kernel, "FLAGS", (*compile_kernel.FLAGS, "-DMORE"))
    names.add(compiled_kernel(source).name)
    monkeypatch.setattr(compile_kernel, "_processor", lambda: "another one")
    names.add(compiled_kernel(source).name)
    assert len(names) == 7


def test_instructions_are_part_of_what_a_processor_is() -> None:
    """`-march=native` goes by them: virtual machines of one model name differ in their flags."""
    given = Path("/proc/cpuinfo")
    if not given.is_file():
        pytest.skip("there is no /proc/cpuinfo here")
    lines = given.read_text(encoding="utf-8").splitlines()
    told = {line for line in lines if line.startswith(("flags", "Features"))}
    assert told
    assert told <= set(compile_kernel._processor().splitlines())


def test_exported_c_is_compiled_at_the_highest_level() -> None:
    """Controllers and steppers are loops and small functions: less makes them slower."""
    require_tool("gcc", install="apt install gcc")
    assert "-O3" in kernel_flags(("gcc",), on_lanes=False)


def test_ctrl_c_does_not_reach_the_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal sends it to every process of the group, of which the compiler is none."""
    require_tool("gcc", install="apt install gcc")
    compiler, started = tmp_path / "slow-gcc", tmp_path / "started"
    compiler.write_text(SLOW.format(started=str(started)))
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    heard = threading.Event()
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.set())

    def press() -> None:
        while not started.exists():
            time.sleep(0.01)
        group = os.getpgid(0)
        for process in Path("/proc").glob("[0-9]*"):
            number = int(process.name)
            try:
                command = (process / "cmdline").read_bytes()
                if os.getpgid(number) == group and str(compiler).encode() in command:
                    os.kill(number, signal.SIGINT)
            except OSError:
                continue
        os.kill(os.getpid(), signal.SIGINT)

    keys = threading.Thread(target=press)
    keys.start()
    try:
        built = compiled_kernel("int f(void) { return 7; }")
        keys.join()
        assert heard.is_set()
        assert built.library.f() == 7
    finally:
        signal.signal(signal.SIGINT, before)
