"""`import msnn`: the verbs as functions, from a script."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.project.new_project import new_project
from tests.cli.test_check import SPEC


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return new_project(tmp_path / "plant") / SPEC


def test_every_public_name_is_there():
    assert all(callable(getattr(msnn, name)) for name in msnn.__all__)
    assert set(msnn.__all__) <= set(dir(msnn))
    with pytest.raises(AttributeError, match="module `msnn` has no attribute `lode`"):
        _ = msnn.lode


def test_load_and_compile_give_the_same_program(spec: Path):
    model = msnn.load(spec)
    assert msnn.compile(spec) == model.program
    assert model.name == "plant"
    assert msnn.compile(model.spec).outputs == model.program.outputs


def test_mistakes_are_raised_with_their_places(spec: Path):
    text = spec.read_text().replace("k*x", "kk*x")
    spec.write_text(text)
    with pytest.raises(msnn.SpecError, match="unknown name `kk`") as caught:
        msnn.load(spec)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.span is not None
    assert "kk*x" in text.splitlines()[diagnostic.span.line - 1]


def test_train_validate_simulate_and_export(spec: Path, tmp_path: Path):
    model = msnn.load(spec, ["train.0.epochs=2"])
    result = msnn.train(model, runs=None)
    assert result.folder is None
    assert set(result.weights) == {"m", "c", "k"}
    report = msnn.validate(model, result.weights)
    assert [row.of for row in report.rows] == ["x_next", "x_next"]
    runs = msnn.simulate(model, weights=result.weights)
    assert len(runs) == 10
    paths = msnn.export(model, "onnx", tmp_path / "out", result.weights)
    assert {path.name for path in paths} >= {"plant.onnx"}
    assert all(path.is_file() for path in paths)


def test_simulating_arrays(spec: Path):
    model = msnn.load(spec)
    force, rest = np.ones(50), np.zeros(50)
    (run,) = msnn.simulate(model, {"F": force, "x": rest, "v": rest}, horizon=40)
    position = run.outputs["x_next"]
    assert position.shape == (40,)
    assert position[0] > 0
    (longer,) = msnn.simulate(model, {"F": list(force), "x": rest, "v": rest})
    np.testing.assert_array_equal(longer.outputs["x_next"][:40], position)


def test_a_horizon_is_a_number_of_steps_or_the_record(spec: Path):
    model = msnn.load(spec)
    rest = {"F": np.ones(50), "x": np.zeros(50), "v": np.zeros(50)}
    (whole,) = msnn.simulate(model, rest)
    (record,) = msnn.simulate(model, rest, horizon="record")
    np.testing.assert_array_equal(record.outputs["x_next"], whole.outputs["x_next"])
    (short,) = msnn.simulate(model, rest, horizon=7)
    assert short.steps == 7
    for wrong in ("episode", "7", 0, -1, 2.5, True):
        with pytest.raises(ValueError, match='`horizon` is "record" or a number of steps'):
            msnn.simulate(model, rest, horizon=wrong)  # pyright: ignore[reportArgumentType]


def test_simulating_files(spec: Path):
    model = msnn.load(spec)
    file = spec.parent / "data" / "test" / "run_01.csv"
    (one,) = msnn.simulate(model, file)
    (same,) = msnn.simulate(model, [file])
    np.testing.assert_array_equal(one.outputs["x_next"], same.outputs["x_next"])


def test_a_spec_without_data_simulates_plain_files(spec: Path, tmp_path: Path):
    text = spec.read_text()
    text = text[: text.index("data:\n")]
    spec.write_text(text)
    file = spec.parent / "data" / "test" / "run_01.csv"
    (run,) = msnn.simulate(msnn.load(spec), file)
    assert len(run.outputs["x_next"]) == 200
    with pytest.raises(msnn.SpecError, match="no `data:` section, which training needs"):
        msnn.train(msnn.load(spec))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"x": [0.0], "v": [0.0]}, r"data\[0\] has no column `F`"),
        ({"F": [0.0, 1.0], "x": [0.0], "v": [0.0]}, "E0841"),
        ({"F": np.zeros((2, 2)), "x": [0.0, 0.0], "v": [0.0, 0.0]}, r"its shape \(2, 2\)"),
        ({"F": 0.0, "x": [0.0], "v": [0.0]}, r"its shape \(\)"),
        ({"F": [np.nan], "x": [0.0], "v": [0.0]}, "E0809"),
    ],
)
def test_arrays_that_do_not_fit(spec: Path, arrays: dict[str, object], message: str):
    with pytest.raises(msnn.SpecError, match=message):
        msnn.simulate(msnn.load(spec), arrays)  # pyright: ignore[reportArgumentType]


def test_exporting_another_target_is_refused(spec: Path, tmp_path: Path):
    with pytest.raises(msnn.SpecError, match="`report` is not an export target"):
        msnn.export(msnn.load(spec), "report", tmp_path / "out")  # pyright: ignore[reportArgumentType]
    assert not (tmp_path / "out").exists()


LOOP = """
msnn: 1
name: loop
sample_time: 1 s
inputs: {a: m, b: m}
outputs:
  y: {expr: a + b, predicts: "a[t]"}
"""


def test_a_loop_that_cannot_be_closed_is_explained(tmp_path: Path):
    path = tmp_path / "loop.yaml"
    path.write_text(LOOP)
    with pytest.raises(msnn.SpecError, match="`a` cannot be closed: its value depends"):
        msnn.simulate(msnn.load(path), {"a": [0.0], "b": [0.0]})


def test_a_record_that_is_too_short_is_an_error(spec: Path):
    text = spec.read_text().replace("F - c*v", "mean(F[t-9:t]) - c*v")
    spec.write_text(text)
    arrays = {name: np.zeros(9) for name in ("F", "x", "v")}
    with pytest.raises(
        msnn.SpecError, match="needs 10 rows without a gap, the longest record has 9"
    ):
        msnn.simulate(msnn.load(spec), arrays)


@pytest.mark.parametrize("choices", ["params: inline", "math: libm, ring: double, unroll: 0"])
def test_the_choices_of_the_c_export_reach_the_code(choices: str, tmp_path: Path) -> None:
    spec = tmp_path / "plant.yaml"
    spec.write_text(
        "msnn: 1\nname: plant\nsample_time: 0.1 s\ninputs: {x: m}\nparameters: {k: 2.5}\n"
        "layers: {h: {fir: {window: 9}}}\n"
        'outputs: {y: "k * sin(h(x))"}\n'
        f"export: {{c: {{{choices}}}}}\n"
    )
    paths = msnn.export(msnn.load(spec), "c", tmp_path / "out")
    header = next(path for path in paths if path.suffix == ".h" and "math" not in path.name)
    assert ("params_t" not in header.read_text()) == ("inline" in choices)
    source = next(path for path in paths if path.name == "plant.c").read_text()
    assert ("sinf(" in source) == ("libm" in choices)


def test_linearize_has_the_slopes_of_one_step() -> None:
    model = msnn.load(Path(__file__).parents[2] / "examples/mass_spring_damper/msd.msnn.yaml")
    history = {"x.history": np.zeros(4), "F.history": np.zeros(1)}
    found = msnn.linearize(model, {"x": 0.0, "F": 0.0}, history)
    x = found.vectors["x"].member("x.history")
    # the oldest kept sample becomes the second oldest one of the step before
    moved = found.matrices["A"][x.first : x.first + x.size, x.first : x.first + x.size]
    assert np.array_equal(moved, np.eye(4, k=1))
    assert found.matrices["C"].shape == (1, 5)
    with pytest.raises(ValueError, match="given for"):
        msnn.linearize(model, {"x": 0.0}, history)
    with pytest.raises(ValueError, match="shape"):
        msnn.linearize(model, {"x": 0.0, "F": [0.0]}, history)


def test_data_are_looked_at_as_the_command_line_does(spec: Path):
    model = msnn.load(spec)
    found = msnn.check_data(model)
    assert [one.name for one in found.datasets] == ["data"]
    assert found.system is not None
    (file, *_) = sorted((spec.parent / "data").rglob("*.csv"))
    one = msnn.check_data(model, file)
    assert len(one.datasets[0].rows.follows) < len(found.datasets[0].rows.follows)
    with pytest.raises(msnn.SpecError, match="no data file"):
        msnn.check_data(model, "nowhere.csv")


def test_arrays_are_looked_at_with_and_without_a_data_section(spec: Path):
    random = np.random.default_rng(2)
    force, x = random.normal(size=400), np.zeros(400)
    for t in range(399):
        x[t + 1] = 0.9 * x[t] + 0.1 * force[t]
    x[200] = 80.0
    columns = {"F": force, "x": x, "v": np.gradient(x)}
    text = spec.read_text()
    short = spec.with_name("short.msnn.yaml")
    short.write_text(text[: text.index("data:")])
    for path in (spec, short):
        found = msnn.check_data(msnn.load(path), columns)
        spikes = [finding for finding in found.findings if "`x`" in finding.message]
        assert spikes, "a value eighty times larger than the others"
        assert found.findings == msnn.check_data(msnn.load(path), [columns]).findings
