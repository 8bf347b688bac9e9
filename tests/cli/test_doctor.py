"""`msnn doctor`: versions of what is there, install lines of what is not."""

from __future__ import annotations

import json
import os
import re
import time
import tomllib
from pathlib import Path

import pytest

from msnn.packages import OPTIONAL, OptionalPackage
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
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    absent = OptionalPackage("no_such_package", "plot", "draws")
    monkeypatch.setattr(installation, "OPTIONAL", (absent,))
    said = msnn("doctor", "--format", "json")
    record = json.loads(said.out)
    parts = {part["name"]: part for part in record["parts"]}
    assert parts["no_such_package"]["found"] is None
    assert parts["no_such_package"]["install"] == absent.install
    own = str(tmp_path / "own" / "msnn" / "kernels")
    assert parts["cache"]["found"] == f"{own} (trusted; 0 kernels, 0.0 MB)"
    refused = {"folder": str(tmp_path / "file" / "kernels"), "reason": "not a directory"}
    empty = {"folder": own, "kernels": 0, "bytes": 0, "refused": {**refused, "trusted": True}}
    assert record["kernels"] == empty
    assert said.err.startswith(f"warning[W1002]: no kernel can be written to {refused['folder']}")


def test_the_cache_is_shown_and_cleaned(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path))
    (tmp_path / "libc.so").write_text("not ours")
    names = (f"{number:032x}" for number in range(3))
    for age, name in enumerate(names):
        for suffix in (".so", ".sha256", ".checked"):
            path = tmp_path / f"{name}{suffix}"
            path.write_bytes(bytes(100_000 if suffix == ".so" else 64))
            then = time.time() - 86_400 * (10 * age)
            os.utime(path, (then, then))
    killed = (tmp_path / f".build-{0:032x}-abc", tmp_path / f".{0:032x}.so.123.part")
    killed[0].mkdir()
    killed[1].touch()
    for path in killed:
        os.utime(path, (0, 0))
    assert f"{tmp_path} (trusted; 3 kernels, 0.3 MB)" in msnn("doctor").out
    said = msnn("doctor", "--clean-cache", "--unused-for", "15")
    assert said.err == f"removed 1 kernel, 0.1 MB, from {tmp_path}\n"
    assert not any(path.exists() for path in killed)
    assert "2 kernels" in said.out
    msnn("doctor", "--clean-cache", "--down-to", "0.15")
    assert {path.stem for path in tmp_path.iterdir()} == {"libc", f"{0:032x}"}
    msnn("doctor", "--clean-cache")
    assert [path.name for path in tmp_path.iterdir()] == ["libc.so"]
    assert msnn("doctor", "--down-to", "3").code == 2


def test_a_folder_of_others_is_not_cleaned(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "ours"))
    theirs = tmp_path / "ours" / f"{0:032x}.so"
    theirs.parent.mkdir()
    theirs.touch()
    theirs.parent.chmod(0o777)
    said = msnn("doctor", "--clean-cache")
    assert (said.code, said.out) == (1, "")
    assert "error[E1053]: nothing is removed" in said.err
    assert theirs.exists()


def test_every_extra_is_looked_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {package.extra for package in OPTIONAL}
    assert named | {"all"} == set(project["optional-dependencies"])
