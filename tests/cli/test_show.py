"""`msnn show`: tables, the program's text, windows, JSON; and the layout of tables."""

from __future__ import annotations

import json
import re
from pathlib import Path

from msnn.tables import table_text
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, SUMMARY, change


def test_the_interface(msnn: CommandLine, project: Path):
    said = msnn("show", SPEC)
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith(SUMMARY)
    assert "F      N     t      this sample  -10 … 10  force on the mass\n" in said.out
    assert "x_next  m     x[t+1]\n" in said.out


def test_previews_lags_and_buffers(msnn: CommandLine, project: Path):
    change(project, "(F - c*v", "(F[t-2] + mean(r[t-1:t+3]) - c*v")
    change(project, "inputs:\n", "inputs:\n  r: N\n")
    said = msnn("show", SPEC).out
    assert "reads the future of r\n" in said
    assert re.search(r"^F +N +t-2 +the sample of 2 steps ago", said, re.M)
    assert "this sample and the next 3" in said
    assert "the past of r\n" in said


def test_windows(msnn: CommandLine, project: Path):
    said = msnn("show", "--windows", SPEC)
    assert "x       target              t+1          t0\n" in said.out
    assert said.out.endswith("needs the rows t0 … t0+N.\n")


def test_json(msnn: CommandLine, project: Path):
    record = json.loads(msnn("show", "--format", "json", SPEC).out)
    assert (record["version"], record["command"], record["model"]) == (1, "show", "plant")
    assert [port["name"] for port in record["inputs"]] == ["F"]


def test_a_doc_cannot_steer_the_terminal(msnn: CommandLine, project: Path):
    change(project, "doc: stiffness", 'doc: "red \\e[31m\\nsecond line"')
    said = msnn("show", SPEC)
    assert "\x1b" not in said.out
    assert "second line" not in said.out


def test_columns_are_as_wide_as_their_widest_cell():
    rows = [("a", "1", "", "x"), ("κκκ", "22.5", "", ""), ("日本", "3", "", "y\n")]
    assert table_text(("name", "n", "empty", "end"), rows, numbers=[1]) == (
        "name     n  end\na        1  x\nκκκ   22.5\n日本     3  y"
    )
