"""The log of trainings: what is written is read, whatever stands beside it."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from msnn.training.records.run_log import Cost, Measured, RunLine, append, read

LINE = RunLine(
    key="k",
    model="plant",
    spec="plant.msnn.yaml",
    spec_sha256="s",
    settings=("train.0.epochs=5",),
    seed=1,
    fold=2,
    data_sha256="d",
    state="finished",
    reason="done",
    monitor=0.5,
    seconds=1.5,
    parameters=3,
    held_out=(
        Measured(
            of="y", unit="m", rollout="one step", scored=9, asked="fit", metrics={"fit": 91.5}
        ),
    ),
    cost=Cost("Cortex-M4F -O2", 84.5, 392, 16),
    folder="plant/compare/k",
    version="1",
)


def test_a_line_is_read_as_it_was_written(tmp_path: Path):
    log = tmp_path / "runs" / "runs.jsonl"
    other = replace(LINE, key="other", fold=None, cost=None, held_out=(), folder=None)
    append(log, LINE)
    append(log, other)
    assert read(log) == [LINE, other]
    assert read(tmp_path / "none.jsonl") == []


def test_what_is_not_finite_is_null_and_read_as_nan(tmp_path: Path):
    log = tmp_path / "runs.jsonl"
    append(log, replace(LINE, monitor=math.inf))
    assert json.loads(log.read_text())["monitor"] is None
    assert math.isnan(read(log)[0].monitor)


def test_a_torn_line_spoils_no_other(tmp_path: Path):
    log = tmp_path / "runs.jsonl"
    append(log, LINE)
    log.write_bytes(log.read_bytes() + log.read_bytes()[:50])
    append(log, LINE)
    assert read(log) == [LINE, LINE]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{}",
        '{"format": 2}',
        "\udcff".encode("utf-8", "surrogateescape").decode("latin-1"),
        '{"format": 1, "key": 3}',
    ],
)
def test_lines_of_others_are_passed_over(tmp_path: Path, text: str):
    log = tmp_path / "runs.jsonl"
    log.write_text(text + "\n")
    append(log, LINE)
    assert read(log) == [LINE]


def test_processes_write_at_once_without_mixing(tmp_path: Path):
    log = tmp_path / "runs.jsonl"
    program = (
        "import sys; from pathlib import Path; from dataclasses import replace\n"
        "from tests.features.comparison.test_run_log import LINE, append\n"
        "for number in range(200):\n"
        "    append(Path(sys.argv[1]), replace(LINE, key=sys.argv[2], seed=number))\n"
    )
    writers = [
        subprocess.Popen([sys.executable, "-c", program, str(log), name]) for name in ("a", "b")
    ]
    assert [writer.wait() for writer in writers] == [0, 0]
    found = read(log)
    for name in ("a", "b"):
        assert [line.seed for line in found if line.key == name] == list(range(200))
