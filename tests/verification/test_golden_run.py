"""What a build answers to the golden vectors is right only if every part of it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msnn.cli.application import run
from msnn.verification.exported_c import ExportedC, read_exported_c
from msnn.verification.harness import differences

SPEC = """
msnn: 1
name: decay
sample_time: 1 s
inputs:
  u: {range: [-1, 1]}
states:
  x: {next: 0.5 * x + u, init: 0, range: [-3, 3]}
outputs:
  y: 3 * x
"""
FINE = "differing 00000000 selftest 00000000\n"


@pytest.fixture(scope="module", params=["float32", "float64", "q15"])
def export(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ExportedC:
    folder = tmp_path_factory.mktemp(str(request.param))
    spec = folder / "decay.msnn.yaml"
    spec.write_text(SPEC, encoding="utf-8")
    setting = f"export.c.dtype={request.param}"
    words = ["export", str(spec), "--initial", "--to", "c", "--out", str(folder), "--set", setting]
    assert run(words) == 0
    return read_exported_c(folder / "c")


def test_the_answer_of_the_interpreter_is_right(export: ExportedC) -> None:
    assert len(export.expected) == export.golden_steps > 100
    assert differences(export, "\n".join([*export.expected, FINE])) == []


@pytest.mark.parametrize(
    ("summary", "said"),
    [
        ("", "the program ended before its last golden step"),
        ("differing 00000002 selftest 00000000\n", "2 golden steps or starts differ"),
        ("differing 00000000 selftest 00000001\n", "the self-test returned 0x00000001"),
        ("differing 00000000 selftest 00000200\n", "the self-test returned 0x00000200"),
    ],
)
def test_a_summary_that_is_missing_or_counts_faults(
    summary: str, said: str, export: ExportedC
) -> None:
    (found,) = differences(export, "\n".join([*export.expected, summary]))
    assert found.startswith(said)


@pytest.mark.parametrize("step", [0, -1])
def test_another_bit_in_the_first_or_the_last_step(step: int, export: ExportedC) -> None:
    # where bits are not promised the program compares within the tolerance, and counts what differs
    export = replace(export, exact=True)
    lines = list(export.expected)
    last = lines[step][-1]
    lines[step] = lines[step][:-1] + ("1" if last == "0" else "0")
    (found,) = differences(export, "\n".join([*lines, FINE]))
    assert f"step {step % len(lines)} answered" in found


def test_an_answer_that_lacks_its_last_step(export: ExportedC) -> None:
    export = replace(export, exact=True)
    (found,) = differences(export, "\n".join([*export.expected[:-1], FINE]))
    assert f"step {len(export.expected) - 1} answered differing" in found


@pytest.mark.parametrize("kept", [0, 1, -1])
def test_answers_that_an_export_has_lost(kept: int, export: ExportedC) -> None:
    """The program is made to replay as many steps as are kept, and would compare only these."""
    lost = replace(export, expected=export.expected[:kept])
    (found,) = differences(lost, "\n".join([*lost.expected, FINE]))
    assert found == (
        f"answers of {len(lost.expected)} golden steps are kept, the vectors have "
        f"{len(export.expected)}"
    )


def test_a_folder_without_answers_is_no_export_that_agrees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O0",))
    spec = tmp_path / "decay.msnn.yaml"
    spec.write_text(SPEC, encoding="utf-8")
    assert run(["export", str(spec), "--initial", "--to", "c", "--out", str(tmp_path)]) == 0
    (tmp_path / "c" / "test" / "decay_expected.txt").write_text("", encoding="utf-8")
    assert run(["verify", str(tmp_path / "c"), "--targets", "host"]) == 1
    assert "answers of 0 golden steps are kept" in capsys.readouterr().out
