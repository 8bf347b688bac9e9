"""Checks run in a process that may die or be given up, and others follow."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from pathlib import Path

import pytest

from msnn.features.language_server.checks import CheckEndedError, CheckProcess
from tests.features.language_server.marked import PLANT


@pytest.fixture
def process() -> Generator[CheckProcess]:
    made = CheckProcess()
    yield made
    made.stop()


def test_a_process_that_died_is_replaced(process: CheckProcess, tmp_path: Path):
    path = str(tmp_path / "plant.msnn.yaml")

    def dies() -> bool:
        os.kill(process._process.pid, signal.SIGKILL)
        return False

    with pytest.raises(CheckEndedError, match="ended"):
        process.examine(path, PLANT, {}, dies)
    assert process.examine(path, PLANT, {}, lambda: False).knowledge is not None


def test_a_check_that_is_given_up_ends(process: CheckProcess, tmp_path: Path):
    path = str(tmp_path / "plant.msnn.yaml")
    with pytest.raises(CheckEndedError, match="given up"):
        process.examine(path, PLANT, {}, lambda: True)
    assert process._process is None
    assert process.examine(path, PLANT, {}, lambda: False).knowledge is not None
