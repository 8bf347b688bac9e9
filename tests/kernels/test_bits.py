"""The compiled C gives the bits of the numpy evaluation, whatever the compiler and its flags."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from compiler.kernels.table import KERNELS, evaluate
from compiler.kernels.tables.formats import RealName
from tests.conditions import require_tool
from tests.kernels.builds import Array, compile_loops, same_bits
from tests.kernels.samples import arguments

DTYPES = {"float": np.float32, "double": np.float64}


@pytest.mark.parametrize(
    ("real", "flag"),
    [
        *(("float", flag) for flag in ("-O0", "-O1", "-O2", "-O3", "-Os", "-O3 -march=native")),
        *(("double", flag) for flag in ("-O0", "-O3")),
    ],
)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_c_has_the_bits_of_numpy(real: RealName, compiler: str, flag: str, tmp_path: Path) -> None:
    require_tool(compiler, f"apt install {compiler}")
    call = compile_loops(tmp_path, real, compiler, tuple(flag.split()))
    for name, kernel in KERNELS.items():
        columns = arguments(DTYPES[real], kernel.arity, 40_000)
        differing = ~same_bits(call(name, *columns), evaluate(name, *columns))
        assert not differing.any(), (name, [column[differing][:3] for column in columns])


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Array]:
    """Single precision at the level that releases have."""
    require_tool("gcc", "apt install gcc")
    return compile_loops(tmp_path_factory.mktemp("kernels"), "float", "gcc", ("-O2",))


@pytest.mark.parametrize("name", KERNELS)
def test_c_has_the_bits_of_numpy_on_millions(name: str, usual: Callable[..., Array]) -> None:
    columns = arguments(np.float32, KERNELS[name].arity, 1_000_000)
    for start in range(0, columns[0].size, 100_000):
        part = [column[start : start + 100_000] for column in columns]
        assert same_bits(usual(name, *part), evaluate(name, *part)).all()


@pytest.mark.parametrize("real", ["float", "double"])
def test_the_sanitizer_finds_nothing_undefined(real: RealName, tmp_path: Path) -> None:
    require_tool("gcc", "apt install gcc")
    trap = ("-O1", "-fsanitize=undefined,float-cast-overflow,bounds-strict")
    # a finding ends the process: conversions out of range, shifts and indices are the ones to fear
    call = compile_loops(tmp_path, real, "gcc", (*trap, "-fsanitize-undefined-trap-on-error"))
    for name, kernel in KERNELS.items():
        columns = arguments(DTYPES[real], kernel.arity, 40_000)
        assert same_bits(call(name, *columns), evaluate(name, *columns)).all(), name


def test_one_element_has_the_bits_of_many() -> None:
    # numpy runs only the branch that all elements take: it must not matter which are together
    for name, kernel in KERNELS.items():
        columns = arguments(np.float32, kernel.arity, 200)
        together = evaluate(name, *columns)
        for i in range(0, together.size, max(1, together.size // 150)):
            alone = evaluate(name, *(np.asarray(column[i]) for column in columns))
            assert alone.shape == ()
            assert same_bits(alone.reshape(1), together[i : i + 1]).all(), (name, i)
