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
    assert re.search(r"^F +input +t +0\.05 s +23$", said.out, re.M)
    assert re.search(r"^x +target +t\+1 +t0 +17$", said.out, re.M)
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


def test_the_resolved_spec_is_the_same_model(msnn: CommandLine, project: Path):
    said = msnn("show", "--resolved", SPEC)
    assert (said.code, said.err) == (0, "")
    assert "      beta1: 0.9\n" in said.out
    (project / "resolved.yaml").write_text(said.out)
    assert msnn("diff", SPEC, "resolved.yaml").out.startswith("the same")
    assert msnn("show", "--resolved", "resolved.yaml").out == said.out


def test_the_ports_of_each_export(msnn: CommandLine, project: Path):
    change(project, "c: {dtype: float32}", "c: {dtype: float32}\n  onnx: {}")
    said = msnn("show", "--interface", SPEC).out
    onnx, c = said.split("\n\n")
    assert onnx.startswith("onnx, float64\n")
    assert c.startswith("c, float32\n")
    assert re.search(r"^in +F +N +-10 … 10 +this sample$", c, re.M)
    assert re.search(r"^out +x_next +m +predicts x\[t\+1\]$", c, re.M)
    assert re.search(r"^state +v +m/s +velocity$", c, re.M)


def test_the_graph_escapes_what_mermaid_would_take_for_its_own(msnn: CommandLine, project: Path):
    change(project, "{unit: N, range", "{unit: 'N', range")
    lines = msnn("show", "--graph", "mermaid", SPEC).out.splitlines()
    assert lines[0] == "flowchart LR"
    number = {found[2]: found[1] for line in lines if (found := _NODE.match(line))}
    assert set(number) == {"F", "m", "c", "k", "x", "v", "a", "x_next"}
    assert f"  {number['k']} --> {number['a']}" in lines
    assert f"  {number['x_next']} -. predicts .-> {number['x']}" in lines
    labels = [line.split('"')[1] for line in lines if '"' in line]
    assert not any(set(label) & set('<>[]{}()|*/"') for label in labels)


_NODE = re.compile(r'^  (n\d+)\W+"(\w+)')


def test_equations_as_latex(msnn: CommandLine, project: Path):
    lines = msnn("show", "--latex", SPEC).out.splitlines()
    assert lines[0] == r"\begin{align*}"
    assert r"  a &= \frac{F - c \, v - k \, x}{m} \\" in lines
    assert r"  \dot{x} &= v \\" in lines
    assert lines[-1] == r"\end{align*}"


def test_one_view_at_a_time(msnn: CommandLine, project: Path):
    said = msnn("show", "--latex", "--windows", SPEC)
    assert said.code == 2
    assert "choose one of" in said.err
