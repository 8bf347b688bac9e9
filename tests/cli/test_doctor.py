"""`msnn doctor`: versions of what is there, install lines of what is not."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from msnn.project import installation
from tests.cli.command_line import ROOT, CommandLine


def test_what_is_there_and_what_is_not(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "kernels"))
    monkeypatch.setenv("CC", "no-such-compiler")
    said = msnn("doctor")
    assert (said.code, said.err) == (0, "")
    assert re.search(r"^numpy +\d+\.\d", said.out, re.M)
    assert re.search(r"^C compiler +missing: apt install gcc", said.out, re.M)
    assert f"{tmp_path / 'kernels'}" in said.out


def test_a_missing_package_and_a_closed_cache(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "file" / "kernels"))
    packages = (("no-such-package", "plot", "draws"),)
    monkeypatch.setattr(installation, "_PACKAGES", packages)
    record = json.loads(msnn("doctor", "--format", "json").out)
    parts = {part["name"]: part for part in record["parts"]}
    assert parts["no-such-package"]["found"] is None
    assert parts["no-such-package"]["install"] == "pip install 'msnn[plot]'"
    assert parts["cache"]["found"] is None


def test_every_extra_is_looked_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {extra for _, extra, _ in installation._PACKAGES if extra is not None}
    assert named == set(project["optional-dependencies"])
