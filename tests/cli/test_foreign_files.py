"""A file that msnn did not write is replaced only where the command line names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.cli.exit_codes import ExitCode
from msnn.exports.table import NAMES
from msnn.verification.verify import write_serve_files
from spec_schema.diagnostics.diagnostic import SpecError
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

OWN = "of the user\n"
_EXPORT = ("export", SPEC, "--initial", "--out", "x", "--to")
TARGETS = [name for name in NAMES if name != "mpc"]
"""A project of `msnn init` has no controller."""


@pytest.mark.parametrize("target", TARGETS)
def test_an_export_replaces_an_older_one_and_no_file_of_the_user(
    target: str, msnn: CommandLine, project: Path
) -> None:
    assert msnn(*_EXPORT, target).code == ExitCode.OK
    assert msnn(*_EXPORT, target).code == ExitCode.OK
    folder = project / "x" / target
    names = sorted(path for path in folder.rglob("*") if path.is_file())
    for name in {names[0], names[-1]}:
        for other in names:
            other.unlink(missing_ok=True)
        name.write_text(OWN)
        said = msnn(*_EXPORT, target)
        assert said.code == ExitCode.DIAGNOSTICS, name
        assert f"error[E1054]: x/{name.relative_to(project / 'x')} is there already" in said.err
        assert [path for path in folder.rglob("*") if path.is_file()] == [name]
        assert name.read_text() == OWN


def test_a_file_beside_those_of_an_export_is_in_nobodys_way(
    msnn: CommandLine, project: Path
) -> None:
    own = project / "x" / "c" / "main.c"
    own.parent.mkdir(parents=True)
    own.write_text(OWN)
    assert msnn(*_EXPORT, "c").code == ExitCode.OK
    assert own.read_text() == OWN


def test_a_simulation_under_no_name_replaces_a_simulation_alone(
    msnn: CommandLine, project: Path
) -> None:
    table = project / "simulation.csv"
    for code in (ExitCode.OK, ExitCode.OK):
        assert msnn("simulate", SPEC, "--initial").code == code
    table.write_text("time,F,x\n0,1,2\n")
    said = msnn("simulate", SPEC, "--initial")
    assert (said.code, "error[E1054]: simulation.csv" in said.err) == (ExitCode.DIAGNOSTICS, True)
    assert table.read_text() == "time,F,x\n0,1,2\n"
    assert msnn("simulate", SPEC, "--initial", "-o", "./simulated.csv").code == ExitCode.OK


def test_files_for_firmware_replace_no_others(msnn: CommandLine, project: Path) -> None:
    assert msnn(*_EXPORT, "c").code == ExitCode.OK
    for _ in range(2):
        write_serve_files(project / "x" / "c", project / "firmware")
    other = project / "other" / "replay.h"
    other.parent.mkdir()
    other.write_text(OWN)
    with pytest.raises(SpecError, match="E1054"):
        write_serve_files(project / "x" / "c", other.parent)
    assert other.read_text() == OWN
