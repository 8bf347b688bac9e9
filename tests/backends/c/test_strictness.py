"""No warning of any compiler or checker, as C99 and as C++17."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from backends.c import COptions, write_c
from backends.c_lowering.options import Extra
from compiler.ir.program import Program
from msnn.verification.host_builds import CLANG_WARNINGS, CPP_WARNINGS, GCC_WARNINGS
from msnn.verification.host_checks import MISRA
from tests.backends.c.c_programs import closed_sample
from tests.backends.c.distinct_sources import distinct
from tests.backends.c.small_programs import (
    conditions,
    filtered,
    nothing_to_do,
    starting_states,
    swapped_states,
)
from tests.conditions import miss, require_tool
from tests.programs import SAMPLES

PROGRAMS: dict[str, Callable[[], Program]] = {
    **{name: lambda name=name: closed_sample(name) for name in SAMPLES},
    "clamp": lambda: filtered("clamp", (-2.0, 3.0), cells=True),
    "hold": lambda: filtered("hold", None, cells=False),
    "conditions": conditions,
    "nothing_to_do": nothing_to_do,
    "starting_states": starting_states,
    "swapped_states": swapped_states,
}

OPTIONS = {
    "float": COptions(),
    "double": COptions(dtype="float64", ring="double"),
    "inline": COptions(params="inline", unroll=1),
    "constant_time": COptions(constant_time=True),
    "jacobian": COptions(extras=("jacobian", "parameter_jacobian")),
    "constant_jacobian": COptions(
        dtype="float64", params="inline", ring="double", constant_time=True, extras=("jacobian",)
    ),
}


def _require_fused_arithmetic() -> None:
    processor = Path("/proc/cpuinfo")
    if not (processor.is_file() and " fma " in processor.read_text(encoding="utf-8")):
        miss("this processor cannot run code for x86 with fused multiply-add")


def _written(name: str, option: str, folder: Path) -> None:
    write_c(PROGRAMS[name](), {}, folder, OPTIONS[option])


def _run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    return output


EVERY_OPTION = ("joint_arm", "swapped_states", "clamp")
"""A network, states that read each other, an input policy: programs that get all options."""
PAIRS = [
    (name, option)
    for number, name in enumerate(PROGRAMS)
    for turn, option in enumerate(OPTIONS)
    if name in EVERY_OPTION or turn % 3 == number % 3
]
"""Every program with two options, those of its neighbours with others."""


@pytest.mark.parametrize(("name", "option"), PAIRS)
def test_compilers_have_nothing_to_say(name: str, option: str, tmp_path: Path) -> None:
    _written(name, option, tmp_path)
    sources = [str(path) for part in ("src", "test") for path in (tmp_path / part).glob("*.c")]
    # gcc's optimiser warns of what it finds; clang warns of what it reads, the same at all levels
    for tool, level, flags in (("gcc", "-O2", GCC_WARNINGS), ("clang", "-O0", CLANG_WARNINGS)):
        compiler = require_tool(tool, install=f"apt install {tool}")
        program = str(tmp_path / tool)
        include = f"-I{tmp_path / 'include'}"
        strict = ["-std=c99", level, "-ffp-contract=off", "-Werror", *flags]
        assert _run([compiler, *strict, include, *sources, "-o", program, "-lm"]) == ""
        assert "agree" in _run([program])


@pytest.mark.parametrize("name", PROGRAMS)
def test_it_is_cpp_as_well(name: str, tmp_path: Path) -> None:
    compiler = require_tool("g++", install="apt install g++")
    _written(name, "float", tmp_path)
    sources = [str(path) for part in ("src", "test") for path in (tmp_path / part).glob("*.c")]
    program, include = str(tmp_path / "program"), f"-I{tmp_path / 'include'}"
    strict = ["-x", "c++", "-std=c++17", "-O0", "-ffp-contract=off", "-Werror", *CPP_WARNINGS]
    assert _run([compiler, *strict, include, *sources, "-o", program, "-lm"]) == ""
    assert "agree" in _run([program])


@pytest.mark.parametrize(
    ("extras", "constant_time"),
    [((), False), (("jacobian", "parameter_jacobian"), True)],  # statements of each, in two runs
    ids=["step", "constant time, with Jacobians"],
)
def test_the_misra_addon_of_cppcheck_finds_nothing(
    extras: tuple[Extra, ...], constant_time: bool, tmp_path: Path
) -> None:
    checker = require_tool("cppcheck", install="apt install cppcheck")
    folders = [tmp_path / name for name in PROGRAMS]
    for folder in folders:
        prefix = f"{folder.name}_x"
        options = COptions(prefix=prefix, constant_time=constant_time, extras=extras)
        write_c(PROGRAMS[folder.name](), {}, folder, options)
    sources = [path for folder in folders for path in sorted(folder.rglob("*.c"))]
    # the kernels have tests of their own, and the test program prints
    own = [path for path in sources if "_math" not in path.name and "_sil" not in path.name]
    checked = distinct(own)
    left_out = "".join(path.read_text(encoding="utf-8") for path in own if path not in checked)
    includes = [f"-I{folder / 'include'}" for folder in folders]
    settings = ["-q", "-j2", *MISRA, "--std=c99", "--enable=style"]
    findings = _run(
        [checker, *settings, "--template={file}:{line} {id}", *includes, *map(str, checked)]
    )
    found = [line for line in findings.splitlines() if "misra-c2012" in line]
    assert [line for line in found if not _is_used(line, left_out)] == []


def _is_used(finding: str, left_out: str) -> bool:
    """Whether it is of a macro that nothing uses (rule 2.5), and what was left out uses it."""
    place, _, rule = finding.rpartition(" ")
    if rule != "misra-c2012-2.5":
        return False
    file, _, line = place.rpartition(":")
    macro = Path(file).read_text(encoding="utf-8").splitlines()[int(line) - 1].split()[1]
    return re.search(rf"\b{re.escape(macro.partition('(')[0])}\b", left_out) is not None


def test_clang_needs_no_flag_to_keep_the_bits(tmp_path: Path) -> None:
    _require_fused_arithmetic()
    compiler = require_tool("clang", install="apt install clang")
    _written("joint_arm", "float", tmp_path)
    sources = [str(path) for part in ("src", "test") for path in (tmp_path / part).glob("*.c")]
    include, program = f"-I{tmp_path / 'include'}", str(tmp_path / "program")
    # haswell has fused multiply-add, which clang uses unless the sources forbid it
    command = [compiler, "-O2", "-march=haswell", include, *sources, "-o", program, "-lm"]
    assert _run(command) == ""
    assert "agree" in _run([program])


def test_a_processor_with_half_precision_is_no_reason_to_refuse(tmp_path: Path) -> None:
    compiler = require_tool("gcc", install="apt install gcc")
    _written("joint_arm", "float", tmp_path)
    sources = [str(path) for path in (tmp_path / "src").glob("*.c")]
    # in the GNU dialects gcc then sets FLT_EVAL_METHOD to 16
    command = [compiler, "-std=gnu11", "-mavx512fp16", f"-I{tmp_path / 'include'}"]
    assert _run([*command, "-fsyntax-only", *sources]) == ""


_REORDERED = 16384
_FLAGS = {
    "order": "-fassociative-math -fno-signed-zeros -fno-trapping-math",
    "reciprocal": "-freciprocal-math",
    "none": "-O2",
}


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("real", ["float", "double"])
@pytest.mark.parametrize("flags", _FLAGS)
def test_a_build_that_reorders_arithmetic_is_found_in_every_model(
    flags: str, real: str, compiler: str, tmp_path: Path
) -> None:
    """This one has no function and no quotient whose bits such flags would change."""
    path = require_tool(compiler, install=f"apt install {compiler}")
    dtype = "float32" if real == "float" else "float64"
    write_c(nothing_to_do(), {}, tmp_path, COptions(dtype=dtype, prefix="plain"))
    main = tmp_path / "main.c"
    main.write_text(
        '#include <stdio.h>\n#include "plain.h"\n'
        'int main(void) { printf("%u", (unsigned)plain_selftest()); return 0; }\n'
    )
    sources = [str(file) for file in (tmp_path / "src").glob("*.c")]
    include, program = f"-I{tmp_path / 'include'}", str(tmp_path / "program")
    options = ["-std=c99", "-O2", "-ffp-contract=off", *_FLAGS[flags].split()]
    _run([path, *options, include, str(main), *sources, "-o", program, "-lm"])
    assert _run([program]) == str(0 if flags == "none" else _REORDERED)


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffp-contract=fast"])
def test_a_build_that_changes_numbers_is_found(flag: str, tmp_path: Path) -> None:
    _require_fused_arithmetic()
    compiler = require_tool("gcc", install="apt install gcc")
    _written("fir_closed_loop", "float", tmp_path)
    sources = [str(path) for part in ("src", "test") for path in (tmp_path / part).glob("*.c")]
    include, program = f"-I{tmp_path / 'include'}", str(tmp_path / "program")
    command = [compiler, "-std=gnu99", "-O2", "-march=haswell", flag, include, *sources]
    done = subprocess.run(
        [*command, "-o", program, "-lm"], capture_output=True, text=True, check=False
    )
    if flag == "-ffast-math":
        assert done.returncode != 0
        assert "ffast-math" in done.stderr
        return
    ran = subprocess.run([program], capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert "selftest" in ran.stdout
