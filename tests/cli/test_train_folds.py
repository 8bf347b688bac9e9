"""`msnn train --folds`: its table, its JSON, and what it refuses."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

SHORT = ("--set", "train.0.epochs=1", "--set", "data.split={by: kfold, k: 2}")


def test_folds_are_trained_compared_and_kept(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--folds", *SHORT)
    assert said.code == 0
    assert "stage 1/1 fit of fold 2/2: 1 epochs" in said.err
    assert re.search(r"^fold +monitor +x_next rmse \[m\], one step +x_next rmse", said.out, re.M)
    assert re.search(r"^mean ± std +\d\S* ± \d", said.out, re.M)
    best = re.search(r"^kept in (\S+); `latest` leads to fold (\d)$", said.out, re.M)
    assert best is not None
    latest = project / "runs" / "plant" / "latest"
    assert latest.resolve() == project / best[1] / f"fold_{best[2]}"
    assert "weights: runs/plant/latest/weights.safetensors" in msnn("validate", SPEC).err


def test_the_run_of_a_fold_is_measured_on_its_own_rows(msnn: CommandLine, project: Path):
    on_fold = (*SHORT, "--set", "validate=[{of: x_next, data: val}]")
    record = json.loads(msnn("train", SPEC, "--folds", *on_fold, "--format", "json").out)
    shown = json.loads(msnn("show", "runs/plant/latest", "--format", "json").out)["commands"]
    for fold in record["folds"]:
        said = msnn("validate", fold["folder"], "--format", "json")
        rows = json.loads(said.out)["metrics"]
        assert [row["value"] for row in rows] == [each["value"] for each in fold["metrics"]]
    best = record["folds"][record["best"] - 1]
    rows = json.loads(msnn(*shlex.split(shown["validate"])[1:], "--format", "json").out)["metrics"]
    assert [row["value"] for row in rows] == [each["value"] for each in best["metrics"]]


def test_rows_that_a_fold_was_trained_on_are_told(msnn: CommandLine, project: Path):
    on_fold = (*SHORT, "--set", "validate=[{of: x_next, data: val}]")
    folds = json.loads(msnn("train", SPEC, "--folds", *on_fold, "--format", "json").out)["folds"]
    first, second = (["--weights", f"{fold['folder']}/weights.safetensors"] for fold in folds)
    measure = ("validate", SPEC, *on_fold)
    assert "W1005" not in msnn(*measure, *first).err
    said = msnn(*measure, *second).err
    assert said.count("warning[W1005]") == 1
    # its own rows, and rows that no fold has
    repaired = re.search(r"`msnn (validate \S+)`", said)
    assert repaired is not None
    assert "W1005" not in msnn(*repaired[1].split()).err
    assert "W1005" not in msnn("validate", SPEC, *SHORT, *second).err
    # what is no fold's run: a file that somebody wrote
    record = project / folds[1]["folder"] / "run.json"
    spoiled = json.loads(record.read_text()) | {"settings": [3, "data.split.fold=two"]}
    record.write_text(json.dumps(spoiled))
    assert "W1005" not in msnn(*measure, *second).err


def test_folds_as_json(msnn: CommandLine, project: Path):
    record = json.loads(msnn("train", SPEC, "--folds", *SHORT, "--format", "json").out)
    kept = json.loads((project / record["folder"] / "folds.json").read_text())
    assert (record["command"], len(record["folds"])) == ("train", 2)
    assert {key: record[key] for key in kept} == kept


def test_folds_that_are_all_trained_leave_nothing_to_resume(msnn: CommandLine, project: Path):
    assert msnn("train", SPEC, "--folds", *SHORT).code == 0
    assert not list(project.rglob("checkpoint.safetensors"))
    said = msnn("train", SPEC, "--folds", "--resume", *SHORT)
    assert said.code == 1
    assert "error[E0915]: no interrupted run to resume in runs/plant" in said.err


def test_other_splits_have_no_folds(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--folds")
    assert said.code == 1
    assert "error[E0947]: there are no folds to train" in said.err
    assert "split: {by: kfold, k: 5}" in said.err
    assert not (project / "runs").exists()
