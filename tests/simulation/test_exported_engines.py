"""`simulate` and `validate` through exports: as the interpreter, within what they compute in."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from msnn.api import measurements
from msnn.cli.application import run
from msnn.exports.running.exported_rollouts import chosen_engine
from msnn.exports.table import listed
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.weights.weights_file import initial_weights
from msnn.validation.reports.report import difference_text, engines_table
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_package, require_tool

ENGINES = ("onnx", "casadi", "c", "fmu")
TYPES = [
    ("onnx", "float64"),
    ("onnx", "float32"),
    ("casadi", "float64"),
    ("c", "float64"),
    ("c", "float32"),
    ("fmu", "float64"),
]

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
dims: {wheel: [front, rear]}
inputs: {u: {dims: wheel}, x: {}}
parameters: {k: {init: [0.5, 0.25], dims: wheel}}
states:
  w: {dims: wheel, der: u - k * w, init: 0.1}
  e: {next: "0.5 * e + sum(u[t-2] * k)", init: x.meas}
outputs:
  x_next: {expr: "tanh(0.8 * x + sum(w) + e) + 0.1 * x[t-1]", predicts: "x[t+1]"}
losses: {fit: "mse(x_next, x[t+1])"}
data: {source: {train: a.csv, test: b.csv}, columns: {u: [u1, u2]}}
validate:
  - {of: x_next, rollout: 7}
  - {of: x_next, metric: max_abs, rollout: record}
  - {of: fit, rollout: 5}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("plant")
    (place / "plant.msnn.yaml").write_text(SPEC)
    random = np.random.default_rng(5)
    for name, rows in (("a", 60), ("b", 80)):
        np.savetxt(
            place / f"{name}.csv",
            random.uniform(-1, 1, (rows, 3)),
            delimiter=",",
            header="u1,u2,x",
            comments="",
        )
    return place


@pytest.fixture(autouse=True)
def _tools() -> None:
    require_tool("gcc", install="apt install gcc")
    for name in ("onnxruntime", "fmpy"):
        require_package(name, install=f"pip install {name}")


def model_in(folder: Path, *settings: str) -> Model:
    return load_model(folder / "plant.msnn.yaml", settings)


@pytest.mark.parametrize(("engine", "dtype"), TYPES)
def test_an_export_simulates_as_the_interpreter(engine: str, dtype: str, folder: Path) -> None:
    model = model_in(folder, f"export.{engine}.dtype={dtype}")
    found = measurements.simulate(model, engine=engine)
    right = measurements.simulate(model, engine="interpreter")
    assert len(found) == len(right) == 2
    # the model forgets by half and more in each step: what a step is off does not grow
    tolerance = 1e-12 if dtype == "float64" else 1e-5
    for ours, judged in zip(found, right, strict=True):
        (name,) = judged.outputs
        assert ours.outputs[name].dtype == np.float64
        # numbers that float32 holds are of the export: the interpreter's have more digits
        single = ours.outputs[name].astype(np.float32).astype(np.float64)
        assert np.array_equal(single, ours.outputs[name]) == (dtype == "float32")
        np.testing.assert_allclose(ours.outputs[name], judged.outputs[name], atol=tolerance)


@pytest.mark.parametrize("engine", ENGINES)
def test_rollouts_are_measured_and_losses_interpreted(engine: str, folder: Path) -> None:
    model = model_in(folder)
    found = measurements.validate(model, engine=engine)
    right = measurements.validate(model, engine="interpreter")
    for ours, judged in zip(found.rows, right.rows, strict=True):
        assert ours.value == pytest.approx(judged.value, rel=1e-5)
        assert ours.scored == judged.scored
    assert found.rows[2].value == right.rows[2].value
    assert [warning.code for warning in found.warnings if warning.code.startswith("W13")] == [
        "W1301"
    ]


def test_one_table_says_how_engines_agree(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    listing = listed("onnx")
    assert listing.runner is not None
    monkeypatch.setattr(type(listing.runner), "is_installed", property(_all_but_onnxruntime))
    model = model_in(folder, "validate=[{of: x_next, rollout: 7}]")
    found = measurements.validate_every_engine(model, initial_weights(model.program))
    header, first, *_ = engines_table(found).splitlines()
    assert header.split()[4:] == ["interpreter", "unit", "native", "torch", "casadi", "c", "fmu"]
    assert all(float(text) < 1e-5 for text in first.split()[-5:])
    monkeypatch.setattr(measurements, "validate_every_engine", lambda *_, **__: found)
    command = ["validate", str(folder / "plant.msnn.yaml"), "--initial", "--engine", "all"]
    assert run(command) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[:2] == [header, first]
    assert "onnx is left out: onnxruntime, which runs ONNX models," in said.err
    assert run([*command, "--format", "json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert list(record["engines"]) == ["interpreter", "native", "torch", "casadi", "c", "fmu"]
    assert list(record["left_out"]) == ["onnx"]
    assert record["passed"] is True


def _all_but_onnxruntime(package: object) -> bool:
    return getattr(package, "name", "") != "onnxruntime"


def test_c_in_fixed_point_takes_no_data(folder: Path) -> None:
    with pytest.raises(SpecError, match="E1301"):
        chosen_engine(model_in(folder, *FIXED), "c")


FIXED = (
    "inputs.u.range=[-1, 1]",
    "inputs.x.range=[-1, 1]",
    "states.w.range=[-9, 9]",
    "states.e.range=[-9, 9]",
    "export.c.dtype=q31",
)


def test_differences_are_relative_where_there_is_something_to_relate_to() -> None:
    assert difference_text(1.5, 1.0) == "5.0e-01"
    assert difference_text(float("nan"), float("nan")) == "0"
    assert difference_text(0.25, 0.0) == "2.5e-01 (of 0)"
