"""A command that is forked says and does what a process of its own does."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.cli.command_line import in_new_process
from tests.command_server import commands


@pytest.mark.parametrize(
    "words",
    [["init", "-q", "plant"], ["check", "nothing.msnn.yaml"], ["check", "--no-such-option"]],
    ids=" ".join,
)
def test_it_says_what_a_process_says(words: list[str], quick: Path, tmp_path: Path):
    folders = tmp_path / "forked", tmp_path / "alone"
    for folder in folders:
        folder.mkdir()
    path = f"{quick}{os.pathsep}{os.environ['PATH']}"
    forked = subprocess.run(
        ["msnn", *words],
        cwd=folders[0],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    alone = in_new_process(words, folders[1])
    assert (forked.returncode, forked.stdout, forked.stderr) == (alone.code, alone.out, alone.err)
    made = [sorted(str(p.relative_to(f)) for p in f.rglob("*")) for f in folders]
    assert made[0] == made[1]


def test_nothing_runs_or_answers_afterwards(tmp_path: Path):
    with commands(tmp_path) as folder:
        address = folder / "msnn.socket"
        assert address.is_socket()
    found = subprocess.run([folder / "msnn", "check"], capture_output=True, text=True, check=False)
    assert found.returncode != 0
    assert "ConnectionRefusedError" in found.stderr
