"""The file of epochs: what others read of it while a training runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.training.records.curves import MetricsLog


def test_a_line_is_there_before_the_file_is_closed(tmp_path: Path):
    path = tmp_path / "metrics.jsonl"
    log = MetricsLog(path)
    log.append({"epoch": 1, "total": float("nan")})
    assert path.read_text() == '{"epoch": 1, "total": null}\n'
    log.close()
    log.append({"epoch": 2})
    assert path.read_text().splitlines()[1:] == ['{"epoch": 2}']
    log.close()


def test_a_full_disk_is_told_with_the_file_and_told_once():
    """What the system did not take is not written again where the file is let go."""
    log = MetricsLog(Path("/dev/full"))
    with pytest.raises(OSError, match="/dev/full"):
        log.append({"epoch": 1})
    log.close()
