"""Results show themselves: short at a prompt, as tables, frames and pictures."""

from __future__ import annotations

import io
import signal
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import msnn
from msnn.api.shown_progress import NotebookLines, heard_by
from msnn.api.trainings import ShownTraining
from msnn.packages import PANDAS, OptionalPackage
from msnn.project.new_project import new_project
from msnn.training.records.progress import EpochEnd, Lines, Silent, StageEnd, StageStart
from msnn.validation.reports.words import rollout_text
from spec_schema.diagnostics.diagnostic import Diagnostic
from tests.cli.test_check import SPEC

WILD = """
msnn: 1
name: gain
inputs: {u: {}, w: {}}
parameters: {k: 2}
outputs: {y: {expr: k * u, predicts: "w[t]"}}
train: [{optimizer: {sgd: {lr: 0.1}}}]
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> msnn.Model:
    path = new_project(tmp_path_factory.mktemp("shown") / "plant") / SPEC
    return msnn.load(path, {"train.0.epochs": 2})


@pytest.fixture(scope="module")
def result(model: msnn.Model) -> ShownTraining:
    return msnn.train(model, runs=None)


def test_a_training_is_short_at_a_prompt_and_has_the_tables_of_the_command_line(
    result: ShownTraining,
) -> None:
    assert repr(result).startswith("<TrainingResult: 1 stage, best 0.")
    assert "\n" not in repr(result)
    assert [line.split()[0] for line in str(result).splitlines() if line] == [
        *("stage", "fit", "parameter", "c", "k", "m")
    ]
    html = result._repr_html_()
    assert html.count("<table>") == 2
    assert "N*s/m" in html


def test_the_frame_of_a_training_has_every_learned_number(result: ShownTraining) -> None:
    frame = result.to_frame()
    assert list(frame["parameter"]) == ["c", "k", "m"]
    assert frame["learned"].to_list() == [float(result.weights[name]) for name in ("c", "k", "m")]
    assert frame["unit"].to_list() == ["N*s/m", "N/m", "kg"]


def test_pictures_are_for_notebooks_or_files(result: ShownTraining, tmp_path: Path) -> None:
    picture = result.plot()
    assert picture._repr_png_().startswith(b"\x89PNG")
    assert result.plot(tmp_path / "losses.svg") == tmp_path / "losses.svg"
    assert b"<svg" in (tmp_path / "losses.svg").read_bytes()


def test_a_kept_training_draws_the_epochs_of_its_folder(model: msnn.Model, tmp_path: Path) -> None:
    kept = msnn.train(model, runs=tmp_path / "runs")
    assert kept.folder is not None
    assert kept.plot()._repr_png_()
    assert f"kept in {kept.folder}" in repr(kept)


def test_validations_and_simulations_have_tables_frames_and_pictures(
    model: msnn.Model, result: ShownTraining
) -> None:
    report = msnn.validate(model, result)
    assert repr(report).startswith("<ValidationReport: 2 measurements, ")
    frame = report.to_frame()
    (limited,) = frame[(frame["limit"] == "≤ 0.003")].to_dict("records")
    assert limited["value"] == report.rows[0].value
    named = frame.set_index(["of", "rollout", "data", "metric"])
    assert named.index.is_unique
    for each in report.measurements:
        for metric, found in each.metrics.items():
            row = named.loc[each.of, rollout_text(each), each.data, metric]
            assert row["value"] == pytest.approx(found.value, rel=0, nan_ok=True)
            assert row["unit"] == ("m" if metric in ("rmse", "mae", "max_abs") else "")
            assert row["scored"] == each.scored
    assert report._repr_html_().count("<table>") == 2
    assert report.plot()._repr_png_()

    runs = msnn.simulate(model, weights=result, horizon=20)
    assert repr(runs) == "<Simulations: 10 runs, 200 steps>"
    assert repr(runs[0]) == "<Simulation of data/train/run_01.csv: 20 steps of x_next>"
    frame = runs.to_frame()
    assert isinstance(frame, pd.DataFrame)
    np.testing.assert_array_equal(frame["x_next"][:20], runs[0].outputs["x_next"])
    np.testing.assert_array_equal(frame["x_next.log"][:20], runs[0].logged["x_next"])
    assert runs.plot()._repr_png_()


def test_frames_ask_for_pandas_by_the_line_that_installs_it(
    result: ShownTraining, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = OptionalPackage("no_such_pandas", PANDAS.extra, PANDAS.purpose)
    monkeypatch.setattr("msnn.api.results.PANDAS", missing)
    with pytest.raises(msnn.MissingExtraError) as caught:
        result.to_frame()
    assert "[pandas]" in "\n".join(caught.value._render_traceback_())


def test_a_function_hears_every_event(model: msnn.Model) -> None:
    heard: list[object] = []
    msnn.train(model, runs=None, progress=heard.append)
    kinds = [type(event) for event in heard]
    # two epochs reach nothing, which is said
    assert kinds == [StageStart, EpochEnd, EpochEnd, Diagnostic, StageEnd]


def test_nobody_watches_a_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert isinstance(heard_by(None), Silent)
    assert isinstance(heard_by(False), Silent)
    assert isinstance(heard_by(True), Lines)


def test_a_terminal_is_shown_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert isinstance(heard_by(None), Lines)
    assert isinstance(heard_by(False), Silent)


def test_a_notebook_is_shown_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msnn.api.shown_progress.in_notebook", lambda: True)
    assert isinstance(heard_by(None), NotebookLines)
    assert isinstance(heard_by(False), Silent)


def test_an_end_before_the_end_has_the_result_with_its_tables(model: msnn.Model) -> None:
    def stop(event: object) -> None:
        if isinstance(event, EpochEnd):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(msnn.TrainingInterruptedError) as ended:
        msnn.train(model, runs=None, progress=stop)
    assert isinstance(ended.value.result, ShownTraining)


def test_a_training_that_diverges_shows_why_and_has_its_result() -> None:
    wild = msnn.load(WILD, {"train.0.optimizer.sgd.lr": 1e30})
    u = np.linspace(-1, 1, 50)
    with pytest.raises(msnn.TrainingDivergedError) as caught:
        msnn.train(wild, {"u": u, "w": 3 * u}, runs=None)
    assert isinstance(caught.value.result, ShownTraining)
    shown = "\n".join(caught.value._render_traceback_())
    assert "train: [{optimizer: {sgd: {lr: 0.1}}}]" in shown
    assert ".result" in shown


def test_what_cannot_hear_of_epochs_is_refused() -> None:
    with pytest.raises(TypeError, match="progress is int"):
        heard_by(3)  # pyright: ignore[reportArgumentType]
