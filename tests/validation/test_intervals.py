"""Prediction intervals: variances by exact slopes, widths of the textbook, whose they are."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import msnn
from compiler.differentiation.sensitivities import ROOT, VARIANCE, with_variances
from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.model.weights.covariance import (
    COVARIANCE,
    Covariance,
    read_covariance,
    write_covariance,
)
from msnn.simulation.intervals import quantile
from msnn.simulation.simulate import simulation_program
from msnn.validation.statistics.coverage import LEVELS, Counts, Coverage
from tests.cli.command_line import CommandLine
from tests.training.cases import compiled

OSCILLATOR = """
msnn: 1
name: oscillator
sample_time: 0.1 s
dims: {gain: 2}
inputs: {u: {unit: N, between: linear}}
parameters: {k: {init: 4, min: 0}, c: 0.3, b: {init: [1, -0.5], dims: gain}, x0: 0.2, unused: 1}
states: {x: {der: v, init: x0}, v: "der: u - k * sin(x) - c * v"}
outputs: {y: b * x, z: 2 * u, w: {expr: c * tanh(x), predicts: "m[t]"}}
targets: {m: {}}
""".replace('v: "der: u - k * sin(x) - c * v"', "v: {der: u - k * sin(x) - c * v}")


def test_variances_are_those_of_the_slopes_over_the_whole_rollout() -> None:
    program = simulation_program(compiled(OSCILLATOR)[0])
    random = np.random.default_rng(0)
    log = {"u": random.normal(size=42)}
    learned = ["b", "c", "k", "x0"]
    weights = {
        "k": np.array(4.0),
        "c": np.array(0.3),
        "b": np.array([1, -0.5]),
        "x0": np.array(0.2),
    }
    root = random.normal(size=(5, 5)) * 0.01

    def outputs(moved: FloatArray) -> dict[str, FloatArray]:
        parts = np.split(moved, [2, 3, 4])
        near = {
            name: weights[name] + part.reshape(weights[name].shape)
            for name, part in zip(learned, parts, strict=True)
        }
        return dict(Interpreter(program, near).rollout(log, np.array([0]), 40).outputs)

    whole = with_variances(program, learned, ["y", "w", "z"])
    found = Interpreter(whole, {**weights, ROOT: root}).rollout(log, np.array([0]), 40).outputs
    for name in ("y", "w", "z"):
        np.testing.assert_array_equal(found[name], outputs(np.zeros(5))[name])
        # central differences along each column of the root: their error is of the step's square
        h = 1e-4
        slopes = [
            (outputs(h * column)[name] - outputs(-h * column)[name]) / (2 * h) for column in root.T
        ]
        np.testing.assert_allclose(
            found[f"{VARIANCE}{name}"], np.sum(np.square(slopes), axis=0), rtol=1e-6, atol=1e-14
        )


LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: 1, b: 0.5}
outputs: {z: {expr: a * u + b, predicts: y}}
data: {source: {train: train.csv, test: test.csv}}
train: [{optimizer: levenberg_marquardt, epochs: 10}]
""".replace("predicts: y}", 'predicts: "y[t]"}')


def write_line(folder: Path, rows: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    for name, count in (("train", rows), ("test", 4000)):
        u = random.uniform(-2, 3, count)
        table = np.stack([u, 0.7 * u + 2.0 + random.normal(0, 0.3, count)], axis=1)
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="u,y", comments="")
    (folder / "line.msnn.yaml").write_text(LINE)


@pytest.fixture
def line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_line(tmp_path, 12, seed=1)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_bands_of_a_straight_line_are_those_of_the_textbook(line: Path) -> None:
    model = msnn.load("line.msnn.yaml")
    result = msnn.train(model)
    (run,) = msnn.simulate(model, "test.csv", result, data_set="test", intervals=80)
    u, y = np.loadtxt("train.csv", delimiter=",", skiprows=1).T
    columns = np.stack([u, np.ones_like(u)], axis=1)
    estimate, (squares,), *_ = np.linalg.lstsq(columns, y)
    variance = squares / 10
    at = np.loadtxt("test.csv", delimiter=",", skiprows=1)[:, :1]
    at = np.concatenate([at, np.ones_like(at)], axis=1)
    leverage = np.einsum("ni,ij,nj->n", at, np.linalg.inv(columns.T @ columns), at)
    # Montgomery, Introduction to Linear Regression Analysis, 2012, eq. 2.45, with a normal quantile
    expected = quantile(0.8) * np.sqrt(variance * (1 + leverage))
    np.testing.assert_allclose(run.bands["z"], expected, rtol=1e-6)
    np.testing.assert_allclose(run.outputs["z"], at @ estimate, rtol=1e-6)
    # the folder of the run says the same as the result
    (again,) = msnn.simulate(model, "test.csv", result.folder, data_set="test", intervals=80)
    np.testing.assert_array_equal(again.bands["z"], run.bands["z"])


@pytest.mark.parametrize("engine", ["interpreter", "native", "torch"])
def test_every_engine_counts_alike(line: Path, engine: str) -> None:
    write_line(line, 400, seed=2)
    model = msnn.load("line.msnn.yaml")
    result = msnn.train(model)
    (found,) = msnn.validate(model, result, intervals=True, engine=engine).measurements
    assert found.coverage is not None
    # 4000 independent values: a share varies by 0.008 at 50 %, 0.0034 at 95 %; three of these, and
    # the estimate of σ from 400 values varies by 3.5 %, which moves the shares by 0.011 and 0.004
    allowances = (0.04, 0.03, 0.015)
    for share, level, allowed in zip(found.coverage.observed, LEVELS, allowances, strict=True):
        assert abs(share - level) < allowed
    assert found.coverage.verdict == "as wide as they say"
    assert found.coverage.count == 4000
    report = msnn.validate(model, result, engine=engine)
    assert report.measurements[0].coverage is None


def test_intervals_say_where_they_are_too_narrow(line: Path) -> None:
    write_line(line, 400, seed=2)
    result = msnn.train(msnn.load("line.msnn.yaml"))
    u, y = np.loadtxt("test.csv", delimiter=",", skiprows=1).T
    for factor, verdict in ((2.0, "too narrow"), (0.5, "too wide")):
        table = np.stack([u, 0.7 * u + 2.0 + factor * (y - 0.7 * u - 2.0)], axis=1)
        np.savetxt("test.csv", table, delimiter=",", header="u,y", comments="")
        (found,) = msnn.validate(msnn.load("line.msnn.yaml"), result, intervals=True).measurements
        assert found.coverage is not None
        assert found.coverage.verdict.startswith(verdict)


def test_the_command_line_writes_intervals(line: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_msnn = CommandLine(line, capsys)
    assert run_msnn("train", "line.msnn.yaml").code == 0
    plain = run_msnn("simulate", "line.msnn.yaml", "--out", "plain.csv")
    found = run_msnn("simulate", "line.msnn.yaml", "--out", "bands.csv", "--intervals", "95")
    assert (plain.code, found.code) == (0, 0)
    with Path("bands.csv").open() as file:
        rows = list(csv.DictReader(file))
    columns = [name for name in rows[0] if name.startswith("z")]
    assert columns == ["z", "z.log", "z.low", "z.high"]
    first = {name: float(rows[0][name]) for name in columns}
    assert first["z.low"] < first["z"] < first["z.high"]
    kept = [
        re.sub(",[^,]*,[^,]*$", "", text) for text in Path("bands.csv").read_text().splitlines()
    ]
    assert kept == Path("plain.csv").read_text().splitlines()
    shown = run_msnn("validate", "line.msnn.yaml", "--intervals")
    assert "in 50%  in 80%  in 95%" in shown.out
    told = run_msnn("validate", "line.msnn.yaml", "--intervals", "--format", "json")
    (output,) = json.loads(told.out)["outputs"]
    assert output["intervals"]["levels"] == [0.5, 0.8, 0.95]


FALL = """
msnn: 1
name: fall
sample_time: 0.1 s
dims: {place: 2}
inputs: {}
targets: {m: {dims: place}}
parameters: {c: {init: 0.1, dims: place}}
states: {x: {dims: place, der: -c * x, init: {fit: {over: 30}}}}
outputs: {y: {expr: x, predicts: "m[t]"}}
data: {source: {train: "train*.csv", test: test.csv}, columns: {m: "m{1..2}"}}
train: [{optimizer: levenberg_marquardt, rollout: record, epochs: 20}]
validate: [{of: y, metric: rmse, rollout: record, data: test}]
"""


def test_elements_of_vectors_have_noise_of_their_own_and_starts_are_fitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(8)
    noise = np.array([0.05, 0.4])
    for name in ("train1", "train2", "test"):
        clean = random.uniform(5, 9, 2) * np.exp(-np.outer(0.1 * np.arange(600), [0.02, 0.05]))
        table = clean + noise * random.normal(size=(600, 2))
        np.savetxt(f"{name}.csv", table, delimiter=",", header="m1,m2", comments="")
    Path("fall.msnn.yaml").write_text(FALL)
    model = msnn.load("fall.msnn.yaml")
    result = msnn.train(model)
    (found,) = msnn.validate(model, result, intervals=True).measurements
    assert found.coverage is not None
    assert found.coverage.elements.shape == (3, 2)
    # 570 values each: three deviations of a share are 0.063, 0.05 and 0.027
    off = np.abs(found.coverage.elements - np.array(LEVELS)[:, np.newaxis])
    assert np.all(off < np.array([[0.07], [0.06], [0.035]]))
    bands = msnn.simulate(model, None, result, intervals=95)[0].bands["y"]
    np.testing.assert_allclose(bands.mean(axis=0), quantile(0.95) * noise, rtol=0.15)


# ---- which weights a covariance belongs to


def test_a_covariance_is_that_of_its_weights_alone(line: Path) -> None:
    model = msnn.load("line.msnn.yaml")
    result = msnn.train(model)
    folder = result.folder
    assert folder is not None
    found = read_covariance(folder / "weights.safetensors", result.weights)
    assert result.standard_errors is not None
    errors = result.standard_errors.errors
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(found.matrix)), [errors["a"], errors["b"]], rtol=1e-12
    )
    moved = line / "elsewhere.safetensors"
    shutil.copy(folder / "weights.safetensors", moved)
    assert "there is no" in refused(model, moved)
    msnn.train(msnn.load("line.msnn.yaml", ["train.0.epochs=1", "train.0.optimizer=adam"]))
    latest = Path("runs/line/latest")
    shutil.copy(folder / COVARIANCE, latest.resolve() / COVARIANCE)
    assert "belongs to other weights" in refused(model, latest)
    (folder / COVARIANCE).write_bytes(b"nothing")
    assert "cannot be read" in refused(model, folder)


def test_weights_that_no_training_estimated_have_no_intervals(line: Path) -> None:
    model = msnn.load("line.msnn.yaml")
    assert "initial values" in refused(model, None)
    assert "numbers alone" in refused(model, {"a": 1.0, "b": 2.0})
    assert "runs=None" in refused(model, msnn.train(model, runs=None))
    huge = (
        LINE.replace("a * u + b", "a * u + b + 0 * sum(c)")
        .replace("b: 0.5", "b: 0.5, c: {init: 1, dims: many}")
        .replace("inputs:", "dims: {many: 301}\ninputs:")
    )
    Path("huge.msnn.yaml").write_text(huge.replace("levenberg_marquardt", "adam"))
    many = msnn.load("huge.msnn.yaml")
    result = msnn.train(many)
    assert "more than 300 numbers" in refused(many, result)
    assert "more than 300 numbers" in refused(many, result.folder)


def test_intervals_need_rows_that_were_trained_on(line: Path) -> None:
    model = msnn.load("line.msnn.yaml")
    result = msnn.train(model)
    text = LINE.replace("train: train.csv, ", "")
    (line / "later.msnn.yaml").write_text(text)
    assert "no set `train`" in refused(msnn.load("later.msnn.yaml"), result)
    few = np.loadtxt("train.csv", delimiter=",", skiprows=1)[:2]
    np.savetxt("train.csv", few, delimiter=",", header="u,y", comments="")
    assert "2 numbers were learned from 2 values" in refused(model, result)


def test_sets_of_frames_have_the_intervals_of_files(line: Path) -> None:
    del line
    frames = {
        name: dict(zip("uy", np.loadtxt(f"{name}.csv", delimiter=",", skiprows=1).T, strict=True))
        for name in ("train", "test")
    }
    files = msnn.load("line.msnn.yaml")
    (known,) = msnn.simulate(files, "test.csv", msnn.train(files), data_set="test", intervals=95)
    # a spec without data, all of which is in memory
    model = msnn.load(LINE.replace("data: {source: {train: train.csv, test: test.csv}}\n", ""))
    assert model.spec.data is None
    result = msnn.train(model, frames["train"])
    with pytest.raises(msnn.SpecError, match="E1048"):
        msnn.simulate(model, frames["test"], result, intervals=95)
    (run,) = msnn.simulate(model, frames, result, data_set="test", intervals=95)
    np.testing.assert_allclose(run.bands["z"], known.bands["z"], rtol=1e-9)


def test_outputs_that_predict_nothing_have_no_intervals(line: Path) -> None:
    (line / "line.msnn.yaml").write_text(
        LINE.replace(', predicts: "y[t]"', "").replace("data:", "losses: {fit: 'mse(z, y)'}\ndata:")
    )
    model = msnn.load("line.msnn.yaml")
    result = msnn.train(model)
    with pytest.raises(msnn.SpecError, match="E1049"):
        msnn.simulate(model, None, result, intervals=95)


def test_numbers_at_a_bound_are_certain_and_arrays_keep_their_order(tmp_path: Path) -> None:
    weights = {"b": np.array([1.0, 2.0]), "a": np.array(3.0)}
    matrix = np.array([[4.0, 0, 0], [0, 0, 0], [0, 0, 9.0]])
    found = Covariance.sorted_by_name(["b", "a"], weights, matrix)
    write_covariance(tmp_path / COVARIANCE, found)
    again = read_covariance(tmp_path / "weights.safetensors", weights)
    assert list(again.values) == ["a", "b"]
    np.testing.assert_array_equal(np.diagonal(again.matrix), [9, 4, 0])
    assert again.free == 2
    root = again.root(["b"])
    np.testing.assert_allclose(root @ root.T, [[4, 0], [0, 0]])


def refused(model: msnn.Model, weights: object) -> str:
    with pytest.raises(msnn.SpecError) as caught:
        msnn.validate(model, weights, intervals=True)  # type: ignore[arg-type]
    (found,) = caught.value.diagnostics
    assert found.code in ("E1047", "E1048")
    return found.message


# ---- counting


def counted(share: float, level_of_noise: float = 1.0, memory: float = 0.0) -> Coverage:
    """Of 1000 errors that are `share` times as large as the intervals were made for."""
    errors = share * np.random.default_rng(3).normal(size=1000)
    counts = Counts(np.array(level_of_noise))
    counts.add(errors[:300], np.zeros(300), np.zeros(300))
    counts.add(errors[300:], np.zeros(700), np.zeros(700))
    return counts.coverage([np.array([memory, memory])])


def test_shares_are_judged_by_how_many_values_there_are() -> None:
    assert counted(1.0).verdict == "as wide as they say"
    assert counted(1.3).verdict.startswith("too narrow")
    assert counted(0.7).verdict.startswith("too wide")
    # 1000 values whose errors correlate by 0.9 at two lags are worth 236 independent ones
    assert counted(1.0, memory=0.9).effective == pytest.approx(1000 / 4.24)


def test_errors_far_out_are_not_normal() -> None:
    errors = np.where(np.arange(1000) % 10 == 0, 4.0, 0.1)
    counts = Counts(np.array(float(np.mean(errors**2))))
    counts.add(errors, np.zeros(1000), np.zeros(1000))
    assert counts.coverage([]).verdict == "errors are not normal: many small ones, some far out"
    counts = Counts(np.array(1.0))
    counts.add(np.ones(1000), np.zeros(1000), np.zeros(1000))
    assert counts.coverage([]).verdict == "errors are not normal: most of them of one size"


def test_what_was_not_measured_counts_for_nothing_and_what_diverged_is_outside() -> None:
    counts = Counts(np.array([1.0, 1.0]))
    target = np.array([[0.0, np.nan], [0.0, 0.0]])
    prediction = np.array([[0.0, 0.0], [np.nan, 0.0]])
    counts.add(prediction, np.full((2, 2), 3.0), target)
    found = counts.coverage([])
    assert found.count == 3
    np.testing.assert_array_equal(found.elements, np.array([[0.5, 1.0]] * 3))
    assert found.half_width == pytest.approx(2 * quantile(0.95))
    assert found.from_parameters == pytest.approx(0.75)
