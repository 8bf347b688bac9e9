"""The README is what happens: its commands run and print what it shows, its picture is theirs."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command_line import ROOT, CommandLine, in_new_process
from tests.cli.test_check import SPEC, change
from tests.conditions import require_tool
from tests.docs.printed import compared

README = (ROOT / "README.md").read_text(encoding="utf-8")
PICTURE = ROOT / "docs" / "figures" / "plant.svg"
MISTAKE = "error["
"""A `text` block that begins so shows the answer to a spec with a mistake."""


def blocks(language: str) -> list[str]:
    """The blocks that this test runs."""
    mark = "<!-- run by: tests/cli/test_readme.py -->\n"
    return re.findall(rf"^{mark}```{language}\n(.*?)^```", README, re.M | re.S)


def test_the_mistake_that_is_shown(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    (shown,) = (text for text in blocks("text") if text.startswith(MISTAKE))
    assert msnn("check", SPEC).err == shown


def test_the_commands(msnn: CommandLine, monkeypatch: pytest.MonkeyPatch):
    require_tool("gcc", install="apt install gcc")
    printed = ""
    for line in "".join(blocks("sh")).splitlines():
        command = line.partition("    #")[0]
        words = shlex.split(command)
        if words[0] not in {"msnn", "cd"}:
            shell = ["bash", "-c", command]
            done = subprocess.run(shell, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{command}: {done.stderr}"
            continue
        for part in command.split("&&"):
            verb, *words = shlex.split(part)
            if verb == "cd":
                monkeypatch.chdir(words[0])
                continue
            answer = msnn(*words)
            assert answer.code == 0, f"{part}: {answer.err}"
            printed += answer.out
    for shown in blocks("text"):
        if not shown.startswith(MISTAKE):
            tables = shown.replace("\n\n", "\n…\n")  # the page leaves lines out between them
            wrong, _ = compared(f"…\n{tables}…\n", printed)
            assert not wrong, wrong


def test_the_picture_is_what_its_script_draws(tmp_path: Path):
    """The same text; a training that ends a little elsewhere moves curves by less than a pixel."""
    drawn = tmp_path / "plant.svg"
    script = PICTURE.with_suffix(".py")
    subprocess.run([sys.executable, script, drawn], cwd=tmp_path, check=True, capture_output=True)
    number = re.compile(r"-?\d+(?:\.\d+)?")
    shown, now = (path.read_text(encoding="utf-8") for path in (PICTURE, drawn))
    assert number.sub("#", now) == number.sub("#", shown), f"run python {script.relative_to(ROOT)}"
    pairs = zip(number.findall(shown), number.findall(now), strict=True)
    assert all(abs(float(one) - float(other)) < 0.5 for one, other in pairs)


def test_the_page_and_its_pictures_are_small():
    pictures = [ROOT / name for name in re.findall(r"\]\((docs/figures/[\w.]+svg)\)", README)]
    assert pictures
    assert sum(path.stat().st_size for path in [ROOT / "README.md", *pictures]) <= 1_000_000


def test_the_comparison_names_programs_that_exist():
    table = README.partition("## Compared with other tools")[2].partition("\n## ")[0]
    programs = re.findall(r"`(\w+/\w+\.py)\b", table)
    assert len(programs) >= 8
    for program in programs:
        assert (ROOT / "benchmarks" / program).is_file(), program


def test_the_comparison_has_rows_in_which_the_other_tool_is_ahead():
    table = README.partition("## Compared with other tools")[2].partition("\n## ")[0]
    rows = [row.strip("| ").split(" | ") for row in table.splitlines() if row.startswith("| ")]
    ahead = [row[3] for row in rows[1:]]
    assert 0 < sum(name == "msnn" for name in ahead) < len(ahead)
    assert {len(row) for row in rows} == {4}


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
