"""Fixtures of the command line's tests: a command line in an empty folder, a project, weights."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from msnn.project.new_project import new_project
from tests.cli.command_line import CommandLine


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in an empty folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    return CommandLine(tmp_path, capsys)


@pytest.fixture(scope="session")
def made_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return new_project(tmp_path_factory.mktemp("made") / "plant")


@pytest.fixture
def project(msnn: CommandLine, made_project: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A fresh copy of what `msnn init plant` makes; the command line is in it."""
    folder = msnn.folder / "plant"
    shutil.copytree(made_project, folder)
    monkeypatch.chdir(folder)
    return folder
