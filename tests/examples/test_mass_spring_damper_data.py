"""The mass-spring-damper example: exact physics, the same files every time, figures as measured."""

import importlib
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.linalg import expm

FOLDER = Path(__file__).parents[2] / "examples" / "mass_spring_damper"


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    """The script as a module, under a name that no package has."""
    name = "mass_spring_damper_generate_data"
    found = importlib.util.spec_from_file_location(name, FOLDER / "generate_data.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    # dataclass looks its module up by name while the class is made.
    sys.modules[name] = module
    found.loader.exec_module(module)
    return module


def run(generator: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    monkeypatch.setattr(sys, "argv", ["generate_data.py", "--out", str(folder)])
    generator.main()
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_two_runs_write_the_same_forty_files_and_leave_nothing_else(
    generator: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(generator, tmp_path / "once", monkeypatch)
    again = run(generator, tmp_path / "once", monkeypatch)
    elsewhere = run(generator, tmp_path / "other", monkeypatch)
    assert first == again == elsewhere
    assert len(first) == 40
    assert all(name.endswith(".csv") for name in first)
    assert len(set(first.values())) == 40


def test_a_file_has_the_columns_that_the_specs_read(
    generator: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = run(generator, tmp_path, monkeypatch)["train/episode_01.csv"].decode().splitlines()
    assert lines[0] == "time;x;F"
    assert len(lines) == 1 + generator.SAMPLES
    rows = np.array([[float(cell) for cell in line.split(";")] for line in lines[1:]])
    # Times are written with one decimal, so that they are the exact doubles nearest to 0.2 n.
    np.testing.assert_allclose(np.diff(rows[:, 0]), generator.SAMPLE_TIME, rtol=1e-12)


def test_one_sample_is_the_matrix_exponential_with_the_force_held(generator: ModuleType) -> None:
    plant = generator.Plant()
    transition, effect = generator.sampled(plant)
    dynamics = np.array([[0.0, 1.0], [-plant.stiffness / plant.mass, -plant.damping / plant.mass]])
    expected = expm(generator.SAMPLE_TIME * dynamics)
    # Two ways to the same exponential, a handful of rounding errors each.
    np.testing.assert_allclose(transition, expected, rtol=1e-13, atol=1e-15)
    held = np.linalg.solve(dynamics, (expected - np.eye(2)) @ np.array([0.0, 1.0 / plant.mass]))
    np.testing.assert_allclose(effect, held, rtol=1e-12)


def test_a_constant_force_ends_at_the_spring_s_deflection(generator: ModuleType) -> None:
    plant = generator.Plant()
    position = generator.simulate(plant, np.full(600, 3.0), np.random.default_rng(0))
    # 120 s are 45 time constants 2 m / c of the decay: nothing of the start is left.
    assert position[-1] == pytest.approx(3.0 / plant.stiffness, rel=1e-12)


def test_the_tables_of_the_page_are_those_of_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    # of examples/mass_spring_damper/README.md
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.delitem(sys.modules, "results", raising=False)
    found = json.loads((FOLDER / "results.json").read_text(encoding="utf-8"))
    results = importlib.import_module("results")
    monkeypatch.delitem(sys.modules, "results")  # other examples have one too
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert results.with_tables(page, found) == page
