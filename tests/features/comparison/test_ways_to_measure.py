"""Entries of `validate` that differ in what they score alone: each keeps its own figures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import msnn as api
from msnn.project.new_project import new_project
from msnn.training.records.run_log import LOG, read
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

ENTRIES = """\
validate:
  - {of: x_next, metric: rmse, rollout: record, max: 1 m}
  - {of: x_next, metric: rmse, rollout: {horizon: record, skip: 30}}
  - {of: x_next, metric: rmse, rollout: {horizon: record, skip: 30}, skip_rows: 60}
  - {of: x_next, metric: rmse, rollout: record, target: "x[t]"}
"""
WAYS = [
    "record",
    "record, skip 30",
    "record, skip 30, skip_rows 60",
    "record, against x[t]",
]


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in a project that measures one output four ways."""
    folder = new_project(tmp_path / "plant")
    text = (folder / SPEC).read_text()
    head, rest = text.split("validate:")
    tail = rest[rest.index("\nexport:") :]
    (folder / SPEC).write_text(head + ENTRIES + tail)
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def test_a_comparison_keeps_each_way_to_score_an_output(msnn: CommandLine):
    short = ("--set", "train.0.epochs=1")
    assert msnn("compare", SPEC, *short, "--no-cost", "--jobs", "1", "--on", "test").code == 0
    (line,) = read(Path("runs") / LOG)
    said = msnn("validate", f"runs/{line.folder}", "--format", "json").out
    rows = json.loads(said)["metrics"]
    assert [each.rollout for each in line.held_out] == WAYS
    assert [each.metrics["rmse"] for each in line.held_out] == [row["value"] for row in rows]
    assert [each.scored for each in line.held_out] == [row["scored"] for row in rows]
    assert len({row["value"] for row in rows}) == len(WAYS)


def test_what_was_logged_with_fewer_ways_is_trained_again(msnn: CommandLine):
    short = ("--set", "train.0.epochs=1", "--no-cost", "--jobs", "1")
    msnn("compare", SPEC, *short)
    log = Path("runs") / LOG
    line = json.loads(log.read_text())
    line["held_out"] = [{**line["held_out"][3], "rollout": WAYS[0]}]
    log.write_text(json.dumps(line) + "\n")
    assert "trained before" not in msnn("compare", SPEC, *short).err
    assert "trained before" in msnn("compare", SPEC, *short).err


def test_folds_have_a_column_for_each_way(msnn: CommandLine):
    split = ("--set", "data.split={by: kfold, k: 2}", "--folds")
    said = msnn("train", SPEC, "--set", "train.0.epochs=1", *split, "--format", "json")
    assert said.code == 0
    columns = [each["of"] for each in json.loads(said.out)["summary"]]
    assert columns == ["monitor", *(f"x_next rmse [m], {way}" for way in WAYS)]


@pytest.mark.usefixtures("msnn")
def test_a_limit_stands_beside_the_way_that_it_is_of():
    model = api.load(SPEC)
    columns = api.validate(model).to_frame()
    of_rmse = [
        (way, limit)
        for way, metric, limit in zip(
            columns["rollout"], columns["metric"], columns["limit"], strict=True
        )
        if metric == "rmse"
    ]
    assert of_rmse == list(zip(WAYS, ["≤ 1", "", "", ""], strict=True))


def test_a_difference_of_two_runs_has_a_row_for_each_way(msnn: CommandLine):
    for epochs in ("1", "2"):
        msnn("train", SPEC, "--set", f"train.0.epochs={epochs}", "-o", f"runs{epochs}")
    said = msnn("diff", "runs1/plant/latest", "runs2/plant/latest", "--format", "json").out
    changed = json.loads(said)["metrics"]
    assert [each["rollout"] for each in changed] == WAYS
