"""Files that a command is given: program files, hostile ones too, and settings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from msnn.cli.exit_codes import ExitCode
from tests.cli.command_line import CommandLine, in_new_process
from tests.cli.test_check import SPEC, SUMMARY

PROGRAM = "build/plant.program.json"


@pytest.fixture
def program_file(msnn: CommandLine, project: Path) -> Path:
    said = msnn("compile", SPEC)
    assert (said.code, said.out) == (0, f"{PROGRAM}\n")
    return project / PROGRAM


def test_a_program_file_serves_as_the_spec(msnn: CommandLine, project: Path, program_file: Path):
    assert msnn("check", PROGRAM).out == SUMMARY
    assert msnn("show", PROGRAM).out == msnn("show", SPEC).out
    assert msnn("show", "--program", PROGRAM).out == msnn("show", "--program", SPEC).out
    found = msnn("validate", PROGRAM, "--initial")
    assert found.out == msnn("validate", SPEC, "--initial").out
    assert found.code == 3


def test_a_program_file_finds_the_data_of_its_spec(
    msnn: CommandLine, project: Path, program_file: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(project / "data")
    said = msnn("simulate", program_file, "--initial")
    assert said.out == "simulation.csv: 10 runs, 2000 steps\n"


def test_compiling_twice_gives_the_same_bytes(msnn: CommandLine, program_file: Path):
    before = program_file.read_bytes()
    msnn("compile", SPEC)
    assert program_file.read_bytes() == before


def changed(path: Path, **changes: Any) -> None:
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, **changes}))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a program file: it is not JSON"),
        ("[" * 100_000, "is not a program file: it is nested too deep"),
        ("[1, 2]", "is not a program file"),
        ("{}", "is not a program file"),
        ('{"format": 99}', "has format 99; this version reads format 1"),
        ('{"format": NaN}', "is not a program file: it is not JSON"),
        ("\udcff", "cannot read build/plant.program.json: it is not utf-8 text"),
    ],
    ids=["empty", "deep", "list", "nothing", "later", "nan", "bytes"],
)
def test_hostile_program_files(msnn: CommandLine, program_file: Path, text: str, message: str):
    program_file.write_bytes(text.encode("utf-8", "surrogateescape"))
    for verb in ("check", "show", "train"):
        said = msnn(verb, PROGRAM)
        assert said.code == 1
        assert said.out == ""
        assert message.lower() in said.err.lower()


@pytest.mark.parametrize("spec", [None, 3, {"path": "x"}, {"path": "a\0", "text": ""}])
def test_a_program_file_without_its_spec(msnn: CommandLine, program_file: Path, spec: Any):
    changed(program_file, spec=spec)
    said = msnn("show", PROGRAM)
    assert said.code == 1
    assert "error[E1040]" in said.err


def test_a_program_file_with_the_spec_of_another(
    msnn: CommandLine, project: Path, program_file: Path
):
    text = (project / SPEC).read_text().replace("init: 10", "init: 11")
    changed(program_file, spec={"path": "../plant.msnn.yaml", "text": text})
    said = msnn("show", PROGRAM)
    assert said.code == 1
    assert "error[E1040]" in said.err


def test_settings_replace_values_of_the_workflow(msnn: CommandLine, project: Path):
    limits = "validate=[{of: x_next, max: 1 km}]"
    assert msnn("validate", SPEC, "--initial").code == 3
    assert msnn("validate", SPEC, "--initial", "--set", limits).code == 0
    assert msnn("validate", SPEC, "--initial", "--set", "validate.0.max=1 km").code == 3


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("train.0.epochs=x", "--> --set:1:17"),
        ("train.0.epoch=3", "unknown key `epoch`"),
        ("train.1.epochs=3", "error[E1032]: `1` is no item of the list"),
        ("train.x=3", "error[E1032]: `x` is no item of the list"),
        ("parameters.kk=3", "error[E1031]: `parameters.kk` cannot be set: it would add `kk`"),
        ("parameters={k: 3}", "error[E1031]: `parameters` cannot be set: it would remove `m`, `c`"),
        ("states.x.derr=v", "unknown key `derr`"),
        ("sample_tim=1 s", "unknown key `sample_tim`"),
        ("train\n=3", "error[E1030]"),
        ("train.0.epochs=[1", "error[E01"),
    ],
)
def test_a_wrong_setting_is_explained(msnn: CommandLine, project: Path, setting: str, message: str):
    said = msnn("validate", SPEC, "--initial", "--set", setting)
    assert said.code == 1
    assert message in said.err
    assert said.out == ""


def test_compile_writes_the_file_that_is_named(msnn: CommandLine, project: Path):
    said = msnn("compile", SPEC, "--out", "out/mine.program.json")
    assert said.code == ExitCode.OK
    assert said.out.strip() == "out/mine.program.json"
    assert (project / "out" / "mine.program.json").is_file()
    assert msnn("check", "out/mine.program.json").code == ExitCode.OK
    assert msnn("compile", SPEC, "--out", "out").out.strip() == "out/plant.program.json"


def test_compile_makes_no_folder_of_a_files_name(msnn: CommandLine, project: Path):
    said = msnn("compile", SPEC, "--out", "out/mine.json")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E1045]" in said.err
    assert "`--out out/mine.program.json`" in said.err
    assert not (project / "out").exists()


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="a full disk that can be had for nothing"
)
def test_a_full_disk_behind_the_standard_output_is_named(project: Path):
    full = "import os; os.dup2(os.open('/dev/full', os.O_WRONLY), 1)"
    start = f"{full}\nfrom msnn.cli.main import main; main()"
    said = in_new_process(("show", SPEC), project, start=start)
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E1033]: cannot use the standard output: no space left" in said.err


def test_a_full_disk_under_a_new_project_is_named(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    def full(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    said = msnn("init", "plant")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E1033]: cannot use plant/" in said.err
