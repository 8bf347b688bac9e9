"""Kernels in constant time: the same bits, nothing undefined, and no branch in what a core runs."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from compiler.kernels.table import KERNELS, evaluate
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.run_routine import run_routine
from compiler.kernels.trace.statements import without_branches
from compiler.kernels.trace.values import trace
from tests.conditions import require_tool
from tests.kernels.builds import STRICT, compile_loops, same_bits, write_sources
from tests.kernels.samples import arguments

DTYPES = {"float": np.float32, "double": np.float64}
M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-std=c99")
CONDITIONAL = re.compile(
    r"\t(b(?:eq|ne|gt|lt|ge|le|hi|ls|cc|cs|mi|pl|vs|vc)(?:\.[nw])?|cbn?z)\s+.*<(\w+)"
)


@pytest.mark.parametrize("real", DTYPES)
@pytest.mark.parametrize("name", KERNELS)
def test_both_blocks_and_a_choice_give_the_same_bits(name: str, real: RealName) -> None:
    routine = without_branches(trace(KERNELS[name].subroutine, FORMATS[real]))
    columns = arguments(DTYPES[real], KERNELS[name].arity, 5_000)
    (found,) = run_routine(routine, columns)
    assert same_bits(found, evaluate(name, *columns)).all()


@pytest.mark.parametrize(("real", "compiler"), [("float", "gcc"), ("float", "clang")])
def test_c_has_the_bits_and_the_sanitizer_nothing_to_say(
    real: RealName, compiler: str, tmp_path: Path
) -> None:
    require_tool(compiler, f"apt install {compiler}")
    checks = "-fsanitize=undefined,float-cast-overflow,bounds"
    flags = ("-O1", checks, "-fsanitize-undefined-trap-on-error")
    call = compile_loops(tmp_path, real, compiler, flags, constant_time=True)
    for name, kernel in KERNELS.items():
        columns = arguments(DTYPES[real], kernel.arity, 20_000)
        assert same_bits(call(name, *columns), evaluate(name, *columns)).all(), name


def test_compilers_warn_of_nothing(tmp_path: Path) -> None:
    require_tool("gcc", "apt install gcc")
    require_tool("clang", "apt install clang")
    for real in FORMATS:
        source = str(write_sources(tmp_path, real, constant_time=True))
        target = str(tmp_path / "kernels.o")
        subprocess.run(["gcc", *STRICT, "-O2", "-c", source, "-o", target], check=True)
        excepted = ("declaration-after-statement", "padded", "unsafe-buffer-usage")
        silent = [f"-Wno-{name}" for name in (*excepted, "unknown-warning-option")]
        strict = ["-std=c99", "-Weverything", *silent, "-Werror", "-ffp-contract=off"]
        subprocess.run(["clang", *strict, "-c", source, "-o", target], check=True)


@pytest.mark.parametrize("level", ["-O1", "-O2", "-O3", "-Os"])
def test_a_core_branches_only_where_a_root_would_be_negative(level: str, tmp_path: Path) -> None:
    require_tool("arm-none-eabi-gcc", "apt install gcc-arm-none-eabi libnewlib-arm-none-eabi")
    source = write_sources(tmp_path, "float", constant_time=True)
    target = tmp_path / "kernels.o"
    command = ["arm-none-eabi-gcc", *M4F, "-ffp-contract=off", level, "-c", source, "-o", target]
    subprocess.run(command, check=True)
    listed = subprocess.run(
        ["arm-none-eabi-objdump", "-d", target], check=True, capture_output=True, text=True
    )
    # what sqrtf does for errno; its argument is never negative
    roots = {"own_asin", "own_acos", "own_sqrt"}
    assert {function for _, function in CONDITIONAL.findall(listed.stdout)} <= roots
