"""Runs, programs and weights of older versions compute the same numbers for ever.

Each folder `version_*` is what `keep.py` wrote with the msnn of its time.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.cli.command_line import CommandLine
from tests.old_runs.keep import EXPECTED, SIMULATED, simulation, validations
from tests.old_runs.same import TOLERANCE, differences, kept

VERSIONS = sorted(Path(__file__).parent.glob("version_*"))


@pytest.fixture(params=VERSIONS, ids=lambda folder: folder.name)
def version(request: pytest.FixtureRequest) -> Path:
    return request.param


@pytest.fixture
def msnn(
    version: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> CommandLine:
    """The command line where runs, program, weights and data are, without any spec."""
    folder = kept(version, tmp_path / "kept")
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def test_there_is_a_version() -> None:
    assert VERSIONS


def test_old_runs_and_programs_validate_to_the_same_numbers(
    version: Path, msnn: CommandLine
) -> None:
    expected = json.loads((version / EXPECTED).read_text())
    assert [one["arguments"] for one in expected] == validations(msnn.folder)
    for one in expected:
        said = msnn(*one["arguments"])
        assert said.code == 0, said.err
        assert not differences(one["numbers"], json.loads(said.out)), one["arguments"]


def test_an_old_run_simulates_the_same_rows_and_intervals(version: Path, msnn: CommandLine) -> None:
    said = msnn(*simulation(msnn.folder))
    assert said.code == 0, said.err
    with (version / SIMULATED).open() as before, (msnn.folder / SIMULATED).open() as now:
        then, found = list(csv.DictReader(before)), list(csv.DictReader(now))
    assert len(then) == len(found)
    for old, new in zip(then, found, strict=True):
        for name, text in old.items():
            if name in ("file", "set") or not text:
                assert new[name] == text
            else:
                assert float(new[name]) == pytest.approx(float(text), rel=TOLERANCE)


@pytest.mark.parametrize("engine", ["native", "c"])
def test_other_engines_run_old_runs(engine: str, version: Path, msnn: CommandLine) -> None:
    words = [engine if word == "interpreter" else word for word in validations(msnn.folder)[-2]]
    said = msnn(*words)
    assert said.code == 0, said.err


def test_a_number_that_changes_is_seen(version: Path) -> None:
    expected = json.loads((version / EXPECTED).read_text())[0]["numbers"]
    changed = json.loads(json.dumps(expected))
    assert not differences(expected, changed)
    changed["outputs"][0]["metrics"]["rmse"] *= 1 + 1e-7
    assert differences(expected, changed) == ["outputs[0].metrics.rmse"]
    del changed["metrics"][0]["value"]
    assert differences(expected, changed) == ["metrics[0].value", "outputs[0].metrics.rmse"]
