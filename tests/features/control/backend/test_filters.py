"""Generated filters agree with the filter in Python, are bits alike, and stay positive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from backends.c.host.build import build_library
from backends.c_language.literals import Dtype
from msnn.features.control.backend.library import FilterLibrary
from msnn.features.control.backend.write_estimator import write_estimator
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.problem.state_estimation import EstimationProblem
from tests.conditions import require_tool
from tests.features.control.backend.strict_builds import build_strictly
from tests.features.control.specs import DELAYED, kalman_filter, load
from tests.features.control.test_estimator import LINEAR, PENDULUM

FILTERED, _, DIVERGED, INPUT_NOT_FINITE, NOT_INITIALISED = range(5)
VECTORS = """
msnn: 1
name: vectors
sample_time: 0.1 s
dims: {place: [left, right], seen: 3}
inputs: {heat: {dims: [place]}, wind: {}}
parameters: {k: {init: 0.4, min: 0}, C: {dims: [seen, place], init: 0.5}}
states:
  T: {dims: [place], der: "heat - k * T - 0.02 * T**2", init: T.meas}
outputs:
  warmth: {expr: "C @ T + 0.1 * wind", predicts: "warm[t]"}
targets: {warm: {dims: [seen]}}
estimator:
  ekf:
    measured: {warmth: 0.05}
    process: {T: 0.2}
    initial: {T: 1}
    parameters: {k: {std: 0.2, walk: 0.01, min: 0.1, max: 0.9}}
"""
SPECS = {"linear": LINEAR, "pendulum": PENDULUM, "delayed": DELAYED, "vectors": VECTORS}


def _written(name: str, folder: Path, dtype: Dtype = "float64") -> tuple[Path, KalmanFilter]:
    require_tool("gcc", install="apt install gcc")
    folder.mkdir(exist_ok=True)
    model = load(folder, SPECS[name])
    weights = msnn.initial_weights(model)
    estimation = model.of(EstimationProblem)
    assert estimation is not None
    write_estimator(estimation, weights, folder / "c", prefix="plant", dtype=dtype)
    return folder / "c", kalman_filter(model, weights)


def _built(name: str, folder: Path, dtype: Dtype = "float64") -> tuple[FilterLibrary, KalmanFilter]:
    out, judge = _written(name, folder, dtype)
    # without an optimiser, which takes most of the time: the bits are those of every level
    library = build_library(out, out / "filter.so", flags=("-O0",))
    return FilterLibrary.of_folder(out, library), judge


@pytest.mark.parametrize("name", SPECS)
def test_in_double_precision_it_is_the_filter_in_python(name: str, tmp_path: Path) -> None:
    """Each step begins where Python's is to rounding, so that 1e-11 is what steps add up."""
    library, judge = _built(name, tmp_path)
    random = np.random.default_rng(3)
    members = judge.numbers.members
    start = random.uniform(0.2, 0.5, judge.problem.states.size)
    library.reset(start)
    judge.reset(
        {
            m.name: start[m.first : m.first + m.size].reshape([axis.size for axis in m.axes])
            for m in members
            if m.first < len(start)
        }
    )
    for number in range(40):
        inputs = {
            m.name: random.uniform(-0.3, 0.3, [axis.size for axis in m.axes])
            for m in judge.problem.inputs.members
        }
        measured = {
            signal: np.where(random.uniform(size=y.shape) < 0.2, np.nan, y + random.normal(0, 0.1))
            for signal, y in judge.expected(inputs).items()
        }
        expected = judge.correct(measured, inputs)
        found = library.correct(measured, inputs)
        assert found.status == expected.status == FILTERED, number
        np.testing.assert_allclose(found.x, judge.vector, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(library.covariance, judge.covariance, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(found.std**2, np.diagonal(judge.covariance), atol=1e-12)
        innovations = np.concatenate([np.ravel(v) for v in expected.innovations.values()])
        np.testing.assert_allclose(found.innovation, innovations, rtol=1e-10, atol=1e-11)
        assert library.predict(inputs) == judge.predict(inputs) == FILTERED
        np.testing.assert_allclose(library.covariance, judge.covariance, rtol=1e-10, atol=1e-13)


BUILDS: dict[Dtype, tuple[tuple[str, str], ...]] = {
    "float64": (("gcc", "-O0"), ("clang", "-O3")),
    "float32": (("clang", "-O0"), ("gcc", "-O3")),
}
ALL_BUILDS = tuple(build for builds in BUILDS.values() for build in builds)


@pytest.mark.parametrize("name", SPECS)
def test_compilers_and_levels_give_the_bits_that_were_recorded(name: str, tmp_path: Path) -> None:
    for dtype, builds in BUILDS.items():
        out, _ = _written(name, tmp_path / dtype, dtype)
        text = (out / "src" / "plant_ekf_selftest.c").read_text(encoding="utf-8")
        assert "if (hash != 0x" in text
        # every build of each spec, and of one of them in both precisions
        for compiler, level in ALL_BUILDS if name == "pendulum" else builds:
            require_tool(compiler, install=f"apt install {compiler}")
            path = build_library(out, out / f"{compiler}{level}.so", [compiler], (level,))
            assert FilterLibrary.of_folder(out, path).selftest() == 0, (compiler, level, dtype)


def test_other_bits_fail_the_self_test(tmp_path: Path) -> None:
    out, _ = _written("pendulum", tmp_path)
    source = out / "src" / "plant_ekf.c"
    text = source.read_text(encoding="utf-8")
    assert text.count("sum += f * v;") == 1
    source.write_text(text.replace("sum += f * v;", "sum += f * v * 1.0000000000000004;"))
    path = build_library(out, out / "other.so")
    assert FilterLibrary.of_folder(out, path).selftest() == 4
    source.write_text(text.replace("sum += f * v;", "sum += f * v * 1.1;"))
    path = build_library(out, out / "wrong.so")
    assert FilterLibrary.of_folder(out, path).selftest() == 4 | 2


def test_sources_are_c_plus_plus_without_warnings(tmp_path: Path) -> None:
    # in single precision there is more to warn of
    builds: list[tuple[str, Dtype]] = [("pendulum", "float64"), *((n, "float32") for n in SPECS)]
    for name, dtype in builds:
        out, _ = _written(name, tmp_path / f"{name}{dtype}", dtype)
        build_strictly(out)


def test_what_is_not_finite_changes_nothing(tmp_path: Path) -> None:
    library, _ = _built("linear", tmp_path)
    assert library.correct({"p": 1.0}).status == NOT_INITIALISED
    library.reset([0.0, 1.0])
    before = library.correct({"p": 0.1})
    assert library.correct({"p": np.inf}).status == INPUT_NOT_FINITE
    assert library.predict({"u": np.nan}) == INPUT_NOT_FINITE
    assert library.correct({"p": 1e308}).status in (FILTERED, DIVERGED)
    library.reset([0.0, 1.0])
    library.correct({"p": 0.1})
    after = library.correct({})
    np.testing.assert_array_equal(after.x, before.x)
    np.testing.assert_array_equal(after.std, before.std)
    assert np.all(np.isnan(after.innovation))


def test_the_covariance_stays_positive_and_right_in_single_precision(tmp_path: Path) -> None:
    """`benchmarks/mpc/long_filters.py` does a million steps.

    A measurement a hundred thousand times as exact as the process makes P all but singular: as a
    matrix in single precision it is indefinite. Deviations stay those of double precision to the
    rounding of a sum of squares.
    """
    text = LINEAR.replace("place: 20 cm", "place: 1e-5")
    SPECS["exact"] = text
    try:
        single, _ = _built("exact", tmp_path / "single", "float32")
        double, _ = _built("exact", tmp_path / "double")
    finally:
        del SPECS["exact"]
    for each in (single, double):
        each.reset([0.0, 0.0])
    for k in range(5000):
        p = np.float32(np.sin(0.01 * k))
        found, expected = single.correct({"p": p}), double.correct({"p": p})
        assert found.status == FILTERED
        assert np.all(single.variances > 0)
        np.testing.assert_allclose(found.std, expected.std, rtol=1e-4)
        single.predict({"u": 0.0})
        double.predict({"u": 0.0})
