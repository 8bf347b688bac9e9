"""The promise of the C backend: float32 gives the interpreter's bits whatever the compiler does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.host.build import build_library
from backends.c.host.library import CStep
from tests.backends.c.c_programs import (
    assert_same_bits,
    built,
    closed_sample,
    golden,
    replay,
)
from tests.conditions import require_tool
from tests.programs import SAMPLES

STEPS = 2000
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os")
COMPILERS = ("gcc", "clang")
BUILDS = [(compiler, level) for level in LEVELS for compiler in COMPILERS]
EVERY_BUILD = ("joint_arm", "fuzzy_local_models")
"""A network, and fuzzy sets that weigh filters: they get all builds. The others get four each,
their neighbours others."""


def builds_of(name: str) -> list[tuple[str, str]]:
    if name in EVERY_BUILD:
        return BUILDS
    number = list(SAMPLES).index(name)
    return [BUILDS[(4 * number + k) % len(BUILDS)] for k in range(4)]


@pytest.mark.parametrize("name", SAMPLES)
def test_float32_has_no_differing_bit_for_any_compiler_and_level(name: str, tmp_path: Path) -> None:
    program, options = closed_sample(name), COptions()
    vectors = golden(program, options, STEPS, seed=3)
    built(program, tmp_path, options)
    for compiler, level in builds_of(name):
        require_tool(compiler, install=f"apt install {compiler}")
        library = tmp_path / f"{compiler}{level}.so"
        built_by = build_library(tmp_path, library, (compiler,), (level,))
        step = CStep.of_folder(tmp_path, built_by)
        outputs, status = replay(step, vectors)
        assert_same_bits(outputs, vectors.outputs)
        assert np.array_equal(status, vectors.status)
        assert step.selftest() == 0


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize(
    "options",
    [
        COptions(ring="double"),
        COptions(ring="shift"),
        COptions(params="inline"),
        COptions(params="tunable"),
        COptions(unroll=1),
        COptions(unroll=64),
        COptions(constant_time=True),
    ],
    ids=lambda options: (
        f"{options.ring}-{options.params}-{options.unroll}{'-constant' * options.constant_time}"
    ),
)
def test_options_change_no_bit(name: str, options: COptions, tmp_path: Path) -> None:
    program = closed_sample(name)
    vectors = golden(program, options, 300, seed=4)
    step = built(program, tmp_path, options)
    outputs, status = replay(step, vectors)
    assert_same_bits(outputs, vectors.outputs)
    assert np.array_equal(status, vectors.status)
    assert step.selftest() == 0


@pytest.mark.parametrize("name", SAMPLES)
def test_float64_agrees_with_the_judge(name: str, tmp_path: Path) -> None:
    program, options = closed_sample(name), COptions(dtype="float64")
    vectors = golden(program, options, STEPS, seed=5)
    outputs, status = replay(built(program, tmp_path, options), vectors)
    for output, expected in vectors.outputs.items():
        # the kernels and numpy's functions differ in the last place, and these models contract
        np.testing.assert_allclose(outputs[output], expected, rtol=0, atol=1e-12)
    assert np.array_equal(status, vectors.status)


@pytest.mark.parametrize("name", ["fuzzy_local_models", "joint_arm"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_c_library_can_be_used_instead_of_the_kernels(
    name: str, dtype: str, tmp_path: Path
) -> None:
    options = COptions(math="libm", dtype="float32" if dtype == "float32" else "float64")
    program = closed_sample(name)
    vectors = golden(program, options, 300, seed=6)
    step = built(program, tmp_path, options)
    assert not list((tmp_path / "src").glob("*_math.c"))
    assert step.selftest() == 0
    outputs, _ = replay(step, vectors)
    for output, expected in vectors.outputs.items():
        # a library promises a few units in the last place; these models contract
        tolerance = 1e-5 if dtype == "float32" else 1e-12
        np.testing.assert_allclose(outputs[output], expected, rtol=0, atol=tolerance)


def test_two_instances_do_not_touch_each_other(tmp_path: Path) -> None:
    program, options = closed_sample("fuzzy_local_models"), COptions(params="tunable")
    first = built(program, tmp_path, options)
    library = next(tmp_path.glob("*.so"))
    second = CStep.of_folder(tmp_path, library)
    second.tune({"model.gain": np.array([0.9, 0.1, 0.5])})
    vectors = [golden(program, options, 100, seed) for seed in (7, 8)]
    alone = [replay(step, v)[0] for step, v in zip((first, second), vectors, strict=True)]
    for step, v in zip((first, second), vectors, strict=True):
        step.reset(v.start.windows)
    together: list[list[float]] = [[], []]
    for k in range(100):
        for number, step in enumerate((first, second)):
            outputs, _ = step.step({"u": vectors[number].inputs["u"][k]})
            together[number].append(float(outputs["v_next"]))
    for number in range(2):
        assert np.array_equal(together[number], alone[number]["v_next"], equal_nan=True)
    assert_same_bits(alone[0], vectors[0].outputs)
    assert not np.array_equal(alone[1]["v_next"], vectors[1].outputs["v_next"])
