"""Fixtures of reports: a short training of a model whose texts would like to be markup."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from msnn.api import models, trainings
from msnn.api.reports import WrittenReport, report
from msnn.project.new_project import new_project

HOSTILE = "</script><img src=x onerror=\"document.title='owned'\"> & 'quoted'"


@pytest.fixture(scope="session")
def trained_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of what `msnn init` makes; docs and the name of a record are hostile."""
    folder = new_project(tmp_path_factory.mktemp("report") / "plant")
    spec = folder / "plant.msnn.yaml"
    text = spec.read_text(encoding="utf-8")
    text = text.replace("sample_time:", f"doc: {_quoted(HOSTILE)}\nsample_time:", 1)
    text = text.replace("doc: force on the mass", f"doc: {_quoted(HOSTILE)}", 1)
    spec.write_text(text, encoding="utf-8")
    record = next(iter(sorted((folder / "data" / "test").glob("*.csv"))))
    shutil.move(record, record.with_name("a<b>\"&'.csv"))
    result = trainings.train(models.load(spec, ["train.0.epochs=3"]), runs=folder / "runs")
    assert result.folder is not None
    return result.folder


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


@pytest.fixture(scope="session")
def written(trained_run: Path, tmp_path_factory: pytest.TempPathFactory) -> WrittenReport:
    """Its page."""
    return report(trained_run, tmp_path_factory.mktemp("page") / "page.html")
