"""No command puts what it writes in the place of what it reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.cli.exit_codes import ExitCode
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", SPEC, "--initial", "-o", SPEC),
        ("simulate", SPEC, "--initial", "-o", "link"),
        ("simulate", SPEC, "--initial", "--data", "log.csv", "-o", "log.csv"),
        ("simulate", SPEC, "--initial", "-o", "FROM THE SPEC"),
        ("check", SPEC, "-o", SPEC),
        ("show", SPEC, "-o", f"./{SPEC}"),
        ("validate", SPEC, "--initial", "--junit", SPEC),
        ("validate", SPEC, "--initial", "--summary", SPEC),
        ("validate", SPEC, "--initial", "--junit", "FROM THE SPEC"),
        ("data", SPEC, "--json", SPEC),
        ("data", SPEC, "--json", "FROM THE SPEC"),
        ("data", SPEC, "-o", "FROM THE SPEC"),
        ("data", SPEC, "--data", "log.csv", "--json", "log.csv"),
        ("check", SPEC, "-o", "FROM THE SPEC"),
        ("show", SPEC, "-o", "FROM THE SPEC"),
        ("diff", SPEC, SPEC, "-o", "FROM THE SPEC"),
    ],
    ids=" ".join,
)
def test_a_file_that_is_read_is_not_overwritten(
    words: tuple[str, ...], msnn: CommandLine, project: Path
) -> None:
    (project / "link").symlink_to(SPEC)
    log = sorted(project.rglob("*.csv"))[0]
    (project / "log.csv").write_bytes(log.read_bytes())
    before = {path: path.read_bytes() for path in project.rglob("*") if path.is_file()}
    named = [str(log) if word == "FROM THE SPEC" else word for word in words]
    said = msnn(*named)
    assert said.code == ExitCode.USAGE
    assert "is read here and would be overwritten" in said.err
    assert {path: path.read_bytes() for path in project.rglob("*") if path.is_file()} == before


def test_another_file_is_replaced(msnn: CommandLine, project: Path) -> None:
    (project / "old.csv").write_text("old")
    assert msnn("simulate", SPEC, "--initial", "-o", "old.csv").code == 0
    assert (project / "old.csv").read_text().startswith("file,")
