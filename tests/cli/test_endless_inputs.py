"""A pipe or a device in place of a file is refused at once: nobody may ever write into it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from msnn.cli.exit_codes import ExitCode
from tests.cli.command_line import CommandLine

SPEC = "plant.msnn.yaml"
USING = """\
msnn: 1
name: using
sample_time: 0.1 s
use: {part: {spec: PART, weights: WEIGHTS}}
inputs: {r: {}}
connect: {part.x: r, part.u: r}
outputs: {y: part.y}
"""
PART = "msnn: 1\nname: part\nsample_time: 0.1 s\ninputs: {x: {}, u: {}}\noutputs: {y: x + u}\n"


@pytest.fixture(autouse=True)
def limited() -> Iterator[None]:
    """Ends a read that waits, so that a mistake fails a test and does not stop the suite."""

    def stop(*_: object) -> None:
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def pipe(project: Path) -> str:
    os.mkfifo(project / "pipe")
    os.mkfifo(project / "pipe.csv")
    os.mkfifo(project / "pipe.program.json")
    return "pipe"


@pytest.mark.parametrize("file", ["pipe", "/dev/zero"])
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("check", "FILE"), "E1001"),
        (("fmt", "FILE"), "E1001"),
        (("import", "FILE"), "E1308"),
        (("validate", SPEC, "--weights", "FILE"), "E0910"),
        (("simulate", SPEC, "--weights", "FILE"), "E0910"),
        (("export", SPEC, "--weights", "FILE"), "E0910"),
    ],
)
def test_what_is_named_on_the_command_line(
    msnn: CommandLine, pipe: str, file: str, arguments: tuple[str, ...], code: str
) -> None:
    said = msnn(*(file if argument == "FILE" else argument for argument in arguments))
    assert said.code == ExitCode.DIAGNOSTICS
    assert f"error[{code}]" in said.err
    assert ("a pipe" if file == pipe else "a device") in said.err


def test_a_program_file_and_data(msnn: CommandLine, pipe: str) -> None:
    said = msnn("check", "pipe.program.json")
    assert "cannot read pipe.program.json: it is a pipe" in said.err
    said = msnn("simulate", SPEC, "--initial", "--data", "pipe.csv")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E0801]" in said.err  # a pattern finds files, and this is none


@pytest.mark.parametrize(
    ("part", "weights", "code"),
    [("pipe", "none", "E0730"), ("part.msnn.yaml", "pipe", "E0740")],
)
def test_what_a_spec_names(
    msnn: CommandLine, project: Path, pipe: str, part: str, weights: str, code: str
) -> None:
    (project / "part.msnn.yaml").write_text(PART)
    (project / "using.msnn.yaml").write_text(
        USING.replace("PART", part).replace("WEIGHTS", weights)
    )
    assert f"error[{code}]" in msnn("check", "using.msnn.yaml").err


def test_a_run_whose_files_are_pipes(msnn: CommandLine, project: Path) -> None:
    run = project / "runs" / "plant" / "2026-01-01_00-00-00"
    run.mkdir(parents=True)
    (run / "run.json").write_text("{}")
    for name in ("spec.msnn.yaml", "checkpoint.safetensors", "weights.safetensors"):
        os.mkfifo(run / name)
    for arguments in (("check", run), ("validate", run), ("train", SPEC, "--resume")):
        assert msnn(*arguments).code != ExitCode.BUG
    weights = run / "weights.safetensors"
    assert "error[E0910]" in msnn("validate", SPEC, "--weights", weights).err


def test_a_pipe_of_the_shell_is_read(project: Path) -> None:
    command = (sys.executable, "-c", "from msnn.cli.main import main; main()", "check")
    text = (project / SPEC).read_bytes()
    found = subprocess.run([*command, "/dev/stdin"], input=text, capture_output=True, check=False)
    assert found.returncode == 0, found.stderr
