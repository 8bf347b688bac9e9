"""The tour in the README is what happens: its commands run, and print what it shows."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from tests.cli.command_line import ROOT, CommandLine, in_new_process
from tests.cli.test_check import SPEC, change
from tests.conditions import require_tool
from tests.docs.printed import compared

TOUR = (ROOT / "README.md").read_text().partition("## A tour")[2].partition("## What is where")[0]


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TOUR, re.M | re.S)


def test_the_mistake_that_is_shown(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    assert msnn("check", SPEC).err == blocks("text")[0]


def test_the_commands(msnn: CommandLine, monkeypatch: pytest.MonkeyPatch):
    require_tool("gcc", install="apt install gcc")
    said = ""
    for line in "".join(blocks("sh")).splitlines():
        for command in line.split("&&"):
            words = shlex.split(command, comments=True)
            if words[0] == "cd":
                monkeypatch.chdir(words[1])
                continue
            assert words[0] == "msnn"
            found = msnn(*words[1:])
            assert found.code == 0, f"{command}: {found.err}"
            said += found.out
    for shown in blocks("text")[1:]:
        tables = shown.replace("\n\n", "\n…\n")  # the page leaves lines out between them
        wrong, _ = compared(f"…\n{tables}…\n", said)
        assert not wrong, wrong


def test_the_python(project: Path, tmp_path: Path):
    script = tmp_path / "tour.py"
    script.write_text(blocks("python")[0])
    said = in_new_process((), project, start=f"import runpy; runpy.run_path({str(script)!r})")
    assert said.code == 0, said.err
    assert (project / "build" / "onnx" / "plant.onnx").is_file()


def test_the_c_is_that_of_the_project(project: Path):
    program = (project / "README.md").read_text()
    (shown,) = blocks("c")
    for line in shown.splitlines():
        assert line.partition("/*")[0].strip() in program


def test_the_commands_of_the_project(msnn: CommandLine, project: Path):
    (commands, *_) = re.findall(
        r"^```sh\n(.*?)^```", (project / "README.md").read_text(), re.M | re.S
    )
    for line in commands.splitlines():
        words = shlex.split(line, comments=True)
        assert msnn(*words[1:]).code == 0, line
