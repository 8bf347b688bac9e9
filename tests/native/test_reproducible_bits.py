"""The same kernel trains to the same bits, whatever compiles it and whatever runs it."""

from __future__ import annotations

import platform
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from backends.native.sensitivity_kernel import SensitivityKernel
from compiler.differentiation.sensitivities import sensitivities
from compiler.passes.close_loop import close_loop
from msnn.training.train import TrainingOptions, train
from tests.conditions import require_tool
from tests.language.compiled import compiled as compiled_model
from tests.native.kernel_programs import Machine, kernel_program, output
from tests.native.test_kernel import initial, log_of
from tests.training.cases import compiled, dataset

MODEL = """
dims: {cell: 3}
inputs: {u: N}
parameters: {c: 0.5, J: {init: 0.6, min: 0.1}, d: {init: 0.3, min: 0, max: 2}, k: {init: 4, max: 9}}
layers:
  net: {mlp: {hidden: [6, 5], activation: tanh}}
  phi: {fuzzify: {centers: {linspace: [-1, 1, 3]}, dim: cell}}
  lm: {local_model: {by: phi(x), cell: {fir: {window: 4}}}}
targets: {z: m}
states:
  x: {next: "0.9*x + 0.1*net(concat(x, u)) / J", init: z.meas}
  v: {next: "v - 0.1*(k*sin(x) + d*v - exp(-u*u))", init: 0}
outputs: {y: {expr: "c*next(x) + 0.1*v + lm(u) - x*x*x", predicts: "z"}}
"""
"""A network, fuzzy sets, three kinds of bounds, functions, and products of every sort in sums."""

PROCESSORS = {
    "AVX2": ("avx2", "-march=x86-64-v3"),
    "AVX-512": ("avx512f", "-march=x86-64-v4"),
}
"""With vectors of other widths: what /proc/cpuinfo calls them, and their flag."""


def require_processor(name: str) -> str:
    """The flag of such a processor; one that is not here is named as not run, in CI too."""
    feature, flag = PROCESSORS[name]
    try:
        words = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    except OSError:
        words = list[str]()
    if not {feature, "fma"} <= set(words):
        pytest.skip(f"needs a processor with {name}")
    return flag


def host(compiler: str, *flags: str) -> Machine:
    return Machine((require_tool(compiler, install=f"apt install {compiler}"), *flags))


def aarch64() -> Machine:
    compiler = require_tool(
        "aarch64-linux-gnu-gcc", install="apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
    )
    return Machine((compiler,), (require_tool("qemu-aarch64", install="apt install qemu-user"),))


@pytest.fixture(scope="module")
def by_aarch64(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Dtype], tuple[str, str]]:
    """The program of a precision, and what AArch64 says of it."""

    @cache
    def said(dtype: Dtype) -> tuple[str, str]:
        text = kernel_program(close_loop(compiled_model(MODEL), ()), dtype)
        found = output(text, aarch64(), tmp_path_factory.mktemp("aarch64"))
        assert "5 of 5" in found
        return text, found

    return said


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("processor", PROCESSORS)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_compiler_and_a_vector_width_find_the_bits_of_aarch64(
    compiler: str,
    processor: str,
    dtype: Dtype,
    by_aarch64: Callable[[Dtype], tuple[str, str]],
    tmp_path: Path,
) -> None:
    machine = host(compiler, require_processor(processor))
    text, found = by_aarch64(dtype)
    assert output(text, machine, tmp_path) == found


def test_a_processor_without_fma_has_the_same_bits_where_they_are_asked_for(
    tmp_path: Path,
) -> None:
    """By the library, of which QEMU's Nehalem runs the version for such processors."""
    program = close_loop(compiled_model(MODEL), ())
    emulator = require_tool("qemu-x86_64", install="apt install qemu-user")
    without = Machine(("gcc", "-march=x86-64-v2"), (emulator, "-cpu", "Nehalem"))
    machines = {"fused": aarch64(), "twice rounded": without, "asked for": without}
    found = {
        name: output(
            kernel_program(program, "float32", reproducible=name == "asked for"), machine, tmp_path
        )
        for name, machine in machines.items()
    }
    same = [name for name, said in found.items() if said == found["fused"]]
    assert same == ["fused", "asked for"]


STAGES = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: 1}
targets: {z: 1}
parameters: {d: {init: 0.3, min: 0, max: 2}}
layers: {net: {mlp: {hidden: [6, 5], activation: tanh}}}
states: {x: {next: "0.9*x + 0.1*net(concat(x, u)) - 0.1*d*x*x", init: z.meas}}
outputs: {y: {expr: next(x), predicts: "z[t+1]"}}
train:
  - {epochs: 4, batch: 32, engine: native, optimizer: {adam: {lr: 0.01}}, schedule: cosine}
  - {epochs: 4, batch: 32, engine: native, rollout: 12, optimizer: {sgd: {lr: 0.01, momentum: 0.8}}}
  - {epochs: 2, engine: native, optimizer: {lbfgs: {iterations: 6}}}
"""


def test_gcc_and_clang_train_a_network_in_three_stages_to_the_same_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path))
    program, spec = compiled(STAGES)
    series = {name: values[:240] for name, values in log_of(program, 240).items()}
    data = dataset(series, train=[120, 80], val=[40])
    found: list[dict[str, bytes]] = []
    for compiler in ("gcc", "clang"):
        monkeypatch.setenv("CC", require_tool(compiler, install=f"apt install {compiler}"))
        result = train(program, data, spec.train, TrainingOptions(runs=None))
        found.append({name: array.tobytes() for name, array in result.weights.items()})
    by_gcc, by_clang = found
    assert [name for name in by_gcc if by_gcc[name] != by_clang[name]] == []
    started = initial(program)
    assert [name for name in started if by_gcc[name] == started[name].tobytes()] == []


WIDTHS = ("", "-mno-avx512f", "-mno-avx512f -mno-avx2")
"""Flags with which gcc takes vectors of 64, 32 and 16 bytes; a group has 1, 2 or 4 of them."""


def test_compilers_and_vector_widths_sum_the_same_products_of_sensitivities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path))
    program = compiled_model(MODEL)
    names = [parameter.name for parameter in program.parameters]
    physical = np.concatenate([initial(program)[name].ravel() for name in names])
    starts, steps = np.arange(10, 40), np.full(30, 12)
    tools = [require_tool(name, install=f"apt install {name}") for name in ("gcc", "clang")]
    widths = WIDTHS if platform.machine() == "x86_64" else ("",)
    found: list[list[bytes]] = []
    for command in (*(f"{tools[0]} {width}" for width in widths), tools[1]):
        monkeypatch.setenv("CC", command)
        kernel = SensitivityKernel(sensitivities(program, names))
        data = kernel.data(log_of(program), 0, None)
        summed = kernel.products(data, starts, steps, physical)
        apart = kernel.products_of_runs(data, starts, steps, physical, own=2)
        arrays = [x for one in summed.values() for x in (one.curvature, one.slope)]
        arrays += [x for one in apart.values() for x in (one.all.curvature, one.squares)]
        found.append([np.ascontiguousarray(x).tobytes() for x in arrays])
    assert any(map(any, found[0]))
    assert [other == found[0] for other in found] == [True] * len(found)
