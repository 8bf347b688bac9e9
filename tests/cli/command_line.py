"""Runs the command line as a user does, and keeps what it said where."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from msnn.cli.application import run

ROOT = Path(__file__).resolve().parents[2]
_START = "from msnn.cli.main import main; main()"


@dataclass(frozen=True)
class Said:
    """The exit code and both streams of a command."""

    code: int
    out: str
    err: str


class CommandLine:
    """`msnn` in this process, in a folder of its own."""

    def __init__(self, folder: Path, captured: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self._captured = captured

    def __call__(self, *arguments: str | Path) -> Said:
        self._captured.readouterr()
        code = run([str(argument) for argument in arguments])
        streams = self._captured.readouterr()
        return Said(int(code), streams.out, streams.err)


def in_new_process(
    arguments: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None = None,
    start: str = _START,
) -> Said:
    """`msnn` as a process of its own."""
    found = subprocess.run(
        [sys.executable, "-c", start, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    return Said(found.returncode, found.stdout, found.stderr)
