"""The C text: only what is asked for, always the same, accepted by strict checkers."""

import shutil
import subprocess
from pathlib import Path

import pytest

from backends.c_kernels.sources import c_sources
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import FORMATS, RealName
from msnn.verification.host_checks import MISRA
from tests.conditions import require_tool
from tests.golden import assert_golden
from tests.kernels.builds import STRICT, write_sources

HERE = Path(__file__).parent


@pytest.mark.parametrize("real", FORMATS)
def test_golden_text_of_tanh(real: RealName, accept: bool) -> None:
    sources = c_sources(["tanh"], real, "model")
    assert_golden(HERE / f"tanh_{real}.h", sources.header, accept)
    assert_golden(HERE / f"tanh_{real}.c", sources.source, accept)


def test_order_and_repetition_of_names_do_not_matter() -> None:
    assert c_sources(["tanh", "sin", "tanh"], "float", "a") == c_sources(
        ["sin", "tanh"], "float", "a"
    )


def test_only_asked_kernels_are_public() -> None:
    sources = c_sources(["sigmoid"], "float", "a")
    assert dict(sources.functions) == {"sigmoid": "a_sigmoid"}
    assert "static float a_exp(float x)" in sources.source
    assert "a_exp" not in sources.header
    assert "tanh" not in sources.source


@pytest.mark.parametrize(("real", "root"), [("float", "sqrtf"), ("double", "sqrt")])
def test_the_object_needs_no_library_but_the_root(
    real: RealName, root: str, tmp_path: Path
) -> None:
    require_tool("gcc", "apt install gcc")
    require_tool("nm", "apt install binutils")
    source = write_sources(tmp_path, real)
    target = tmp_path / "kernels.o"
    subprocess.run(["gcc", *STRICT, "-O1", "-c", str(source), "-o", str(target)], check=True)
    listed = subprocess.run(["nm", "-u", str(target)], check=True, capture_output=True, text=True)
    assert listed.stdout.split() == ["U", root]


@pytest.mark.parametrize("flag", ["-O0", "-O3"])
@pytest.mark.parametrize("real", FORMATS)
def test_gcc_warns_of_nothing(real: RealName, flag: str, tmp_path: Path) -> None:
    require_tool("gcc", "apt install gcc")
    source = write_sources(tmp_path, real)
    strict = (*STRICT, "-Wlogical-op", "-Wduplicated-cond", "-Wduplicated-branches", flag)
    subprocess.run(["gcc", *strict, "-c", str(source), "-o", str(tmp_path / "o")], check=True)


@pytest.mark.parametrize("real", FORMATS)
def test_clang_warns_of_nothing(real: RealName, tmp_path: Path) -> None:
    require_tool("clang", "apt install clang")
    source = write_sources(tmp_path, real)
    # C99 allows declarations after statements, and padding is no fault
    excepted = ("-Wno-declaration-after-statement", "-Wno-padded", "-Wno-unsafe-buffer-usage")
    known = ("-Wno-unknown-warning-option",)
    flags = ("-std=c99", "-Weverything", *excepted, *known, "-Werror", "-ffp-contract=off")
    subprocess.run(["clang", *flags, "-c", str(source), "-o", str(tmp_path / "o")], check=True)


@pytest.mark.parametrize("real", FORMATS)
def test_the_source_is_also_cpp(real: RealName, tmp_path: Path) -> None:
    require_tool("g++", "apt install g++")
    source = write_sources(tmp_path, real)
    flags = ("-x", "c++", "-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    subprocess.run(["g++", *flags, "-c", str(source), "-o", str(tmp_path / "o")], check=True)


def test_cppcheck_misra_finds_nothing(tmp_path: Path) -> None:
    require_tool("cppcheck", "apt install cppcheck")
    source = write_sources(tmp_path, "float")
    # one file alone cannot show that its public functions are used elsewhere (rule 8.7)
    user = tmp_path / "user.c"
    calls = [
        f"    total += own_{name}({', '.join(['total'] * kernel.arity)});"
        for name, kernel in KERNELS.items()
    ]
    prototype = "float use_all(float start)"
    body = "\n".join(["    float total = start;", *calls, "    return total;"])
    user.write_text(
        f'#include "own_math.h"\n{prototype};\n{prototype}\n{{\n{body}\n}}\n', encoding="utf-8"
    )
    shutil.copy(source, tmp_path / "kernels.c")
    command = ["cppcheck", *MISRA, "--quiet", str(tmp_path / "kernels.c"), str(user)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    findings = [
        line for line in run.stderr.splitlines() if "kernels.c" in line or "own_math.h" in line
    ]
    assert findings == []
