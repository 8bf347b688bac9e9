"""Generated moving-horizon estimators agree with the one in Python and are bits alike."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import msnn
from backends.c.host.build import build_library
from backends.c_language.literals import Dtype
from msnn.features.control.backend.library import FilterLibrary
from msnn.features.control.backend.write_estimator import write_estimator
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.run.moving_horizon import MovingHorizon
from msnn.features.control.run.open_controller import open_estimator
from tests.conditions import require_tool
from tests.features.control.backend.strict_builds import build_strictly
from tests.features.control.backend.test_filters import VECTORS
from tests.features.control.specs import DELAYED, load
from tests.features.control.test_estimator import LINEAR
from tests.features.control.test_moving_horizon import BOUNDED, DRIVEN, LOSING, LOST, drawn, window

SOLVED, CAPPED, FELL_BACK, INPUT_NOT_FINITE, NOT_INITIALISED = range(5)
SPECS = {
    "linear": window(LINEAR, 5),
    "pendulum": window(BOUNDED, 5),
    "delayed": window(DELAYED, 5),
    "vectors": window(VECTORS, 5),
    "driven": window(DRIVEN, 5),
}


def _written(name: str, folder: Path, dtype: Dtype = "float64") -> tuple[Path, MovingHorizon]:
    require_tool("gcc", install="apt install gcc")
    folder.mkdir(exist_ok=True)
    model = load(folder, {**SPECS, "lost": window(LOST, 2)}[name])
    weights = msnn.initial_weights(model)
    estimation = model.of(EstimationProblem)
    assert estimation is not None
    write_estimator(estimation, weights, folder / "c", prefix="plant", dtype=dtype)
    judge = open_estimator(model, weights, "python")
    assert isinstance(judge, MovingHorizon)
    return folder / "c", judge


def _built(
    name: str, folder: Path, dtype: Dtype = "float64"
) -> tuple[FilterLibrary, MovingHorizon]:
    out, judge = _written(name, folder, dtype)
    return FilterLibrary.of_folder(out, build_library(out, out / "horizon.so")), judge


@pytest.mark.parametrize("name", SPECS)
def test_in_double_precision_it_is_the_estimator_in_python(name: str, tmp_path: Path) -> None:
    """Linear plants to rounding. Others to what two solves leave whose residuals are 1e-6: noise
    is off by half of that at most in each number, a gap of 1e-6 of a scale at each of 7 stages, and
    the samples before by as much, of scales of 3 at most."""
    library, judge = _built(name, tmp_path)
    random = np.random.default_rng(3)
    start = random.uniform(0.2, 0.5, judge.problem.states.size)
    library.reset(start)
    members = [m for m in judge.numbers.members if m.first < len(start)]
    judge.reset(
        {
            m.name: start[m.first : m.first + m.size].reshape([axis.size for axis in m.axes])
            for m in members
        }
    )
    near = 1e-4 if name in ("pendulum", "vectors") else 1e-10
    for _ in range(16):
        measured, inputs = drawn(judge, random)
        expected, found = judge.correct(measured, inputs), library.correct(measured, inputs)
        assert found.status == expected.status == SOLVED
        np.testing.assert_allclose(found.x, judge.vector, atol=near)
        std = np.concatenate([np.ravel(expected.std[m.name]) for m in judge.numbers.members])
        np.testing.assert_allclose(found.std, std, atol=1e-10)
        assert library.predict(inputs) == judge.predict(inputs) == SOLVED


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_compilers_and_levels_give_the_bits_that_were_recorded(
    dtype: Dtype, tmp_path: Path
) -> None:
    out, _ = _written("pendulum", tmp_path, dtype)
    text = (out / "src" / "plant_mhe_selftest.c").read_text(encoding="utf-8")
    assert "if (hash != 0x" in text
    for compiler, level in itertools.product(("gcc", "clang"), ("-O0", "-O3")):
        require_tool(compiler, install=f"apt install {compiler}")
        path = build_library(out, out / f"{compiler}{level}.so", [compiler], (level,))
        assert FilterLibrary.of_folder(out, path).selftest() == 0, (compiler, level)


def test_other_bits_fail_the_self_test(tmp_path: Path) -> None:
    out, _ = _written("linear", tmp_path)
    source = out / "src" / "plant_mhe.c"
    text = source.read_text(encoding="utf-8")
    assert text.count("part = root;") == 1
    source.write_text(text.replace("part = root;", "part = root * 1.0000000000000004;"))
    path = build_library(out, out / "other.so")
    assert FilterLibrary.of_folder(out, path).selftest() == 4


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("pendulum", "float64"), *((name, "float32") for name in SPECS)],
)
def test_sources_are_c_plus_plus_without_warnings(name: str, dtype: Dtype, tmp_path: Path) -> None:
    """In single precision there is more to warn of."""
    out, _ = _written(name, tmp_path, dtype)
    build_strictly(out)


def test_what_is_not_finite_changes_nothing(tmp_path: Path) -> None:
    library, _ = _built("linear", tmp_path)
    assert library.correct({"p": 1.0}).status == NOT_INITIALISED
    assert library.predict({"u": 0.0}) == NOT_INITIALISED
    library.reset([0.0, 1.0])
    before = library.correct({"p": 0.1})
    assert before.status == SOLVED
    assert library.correct({"p": np.inf}).status == INPUT_NOT_FINITE
    assert library.predict({"u": np.nan}) == INPUT_NOT_FINITE
    after = library.correct({})
    np.testing.assert_allclose(after.x, before.x, rtol=1e-12)
    assert np.all(np.isnan(after.innovation))


def test_what_nothing_can_follow_is_never_solved(tmp_path: Path) -> None:
    """1e300 in a window, then in what lies before it: statuses say so, estimates stay finite."""
    library, _ = _built("pendulum", tmp_path)
    library.reset([0.3, 0.2])
    random = np.random.default_rng(0)
    for k in range(16):
        found = library.correct({"shadow": 1e300 if k == 4 else random.normal(0.2, 0.02)})
        assert found.status == SOLVED if k < 4 else found.status in (CAPPED, FELL_BACK)
        assert np.all(np.isfinite(found.x))
        assert 1 <= found.x[2] <= 7
        assert library.predict({"torque": 0.0}) == SOLVED
    library.reset([0.3, 0.2])
    assert library.correct({"shadow": 0.2}).status == SOLVED


def test_a_lost_arrival_filter_is_replaced_as_in_python(tmp_path: Path) -> None:
    """To what two solves leave whose residuals are 1e-6, of numbers of size 1."""
    library, judge = _built("lost", tmp_path)
    library.reset([2.0])
    for value in LOSING:
        if value is not None:
            expected, found = judge.correct({"y": value}), library.correct({"y": value})
            assert found.status == expected.status == SOLVED
            np.testing.assert_allclose(found.x, judge.vector, atol=1e-5)
        assert library.predict({}) == judge.predict()


def test_single_precision_is_near(tmp_path: Path) -> None:
    """Residuals of 1e-3 leave noise and start off by half of that, of deviations of 2 at most."""
    library, judge = _built("linear", tmp_path, "float32")
    library.reset([0.5, 0.0])
    judge.reset({"p": 0.5, "v": 0.0})
    random = np.random.default_rng(1)
    for _ in range(30):
        measured, inputs = drawn(judge, random)
        judge.correct(measured, inputs)
        found = library.correct(measured)
        assert found.status == SOLVED
        np.testing.assert_allclose(found.x, judge.vector, atol=2e-3)
        judge.predict(inputs)
        library.predict(inputs)


def test_a_number_that_is_measured_twice_counts_once(tmp_path: Path) -> None:
    library, judge = _built("linear", tmp_path)
    library.reset([0.5, 0.0])
    judge.reset({"p": 0.5, "v": 0.0})
    for k in range(7):
        expected = judge.correct({"p": 0.1 * k})
        assert library.correct({"p": 5.0}).status == SOLVED
        found = library.correct({"p": 0.1 * k})
        np.testing.assert_allclose(found.x, judge.vector, atol=1e-9)
        std = [expected.std["p"], expected.std["v"]]
        np.testing.assert_allclose(found.std, std, atol=1e-10)
        assert np.all(np.isnan(found.innovation))
        assert library.predict({"u": 0.1}) == judge.predict({"u": 0.1})
    library.correct({"p": 0.0})
    assert library.correct({"p": np.inf}).status == INPUT_NOT_FINITE
