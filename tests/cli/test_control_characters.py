"""No name of a file, a column or an entry begins a line of a log or steers a terminal."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.command_line import CommandLine, in_new_process
from tests.cli.test_check import SPEC

EVIL = "x\n::error title=t::y\r::error title=t::z\x1b[2J\x9b1m\u2028w\u202ev"
"""A command to GitHub, a cleared screen, a line of Unicode, text from right to left."""
_STEERS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e]")
_QUOTED = json.dumps(EVIL)
FORMATS = ("text", "json", "github", "sarif")

CHANGES = {
    "a unit": ("unit: N,", f"unit: {_QUOTED},"),
    "a key": ("k: {init", f"{_QUOTED}: {{init"),
    "a name": ("name: plant", f"name: {_QUOTED}"),
    "a formula": ("(F - c*v - k*x) / m", f"{_QUOTED}"),
    "a choice": ("integrator: rk4", f"integrator: {_QUOTED}"),
    "a column": ("  time: time", f"  columns: {{F: {_QUOTED}}}\n  time: time"),
    "a time": ("  time: time", f"  time: {_QUOTED}"),
    "a pattern": ("data/train/*.csv", EVIL.replace("\n", "\\n")),
    "a set": ("test: data/test/*.csv", f"{_QUOTED}: data/test/*.csv"),
    "a target": ("predicts: x[t+1] ", f"predicts: {_QUOTED} "),
    "a metric": ("metric: rmse, max: 3 mm", f"metric: {_QUOTED}, max: 3 mm"),
    "a stage": ("- name: fit", f"- name: {_QUOTED}"),
    "a loss": ("of: x_next, metric: rmse, max: 3 mm", f"of: {_QUOTED}"),
    "a sub-model": ("equations:", f"use: {{p: {{spec: {_QUOTED}}}}}\n\nequations:"),
    "a doc": ("doc: mass}", f"doc: {_QUOTED}}}"),
}


def harmless(*texts: str) -> None:
    """AssertionError where a line is a command of GitHub, or a character steers a terminal."""
    for text in texts:
        assert not _STEERS.search(text.replace("\x1b[2K", "").replace("\r", "")), text
        for line in re.split("[\r\n]", text):
            said = line.lstrip()
            assert not said.startswith("::") or "title=t::" not in said.partition(",file=")[0], text


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("change", CHANGES)
def test_what_a_spec_says_stays_in_its_line(
    change: str, format: str, msnn: CommandLine, project: Path
) -> None:
    spec = project / SPEC
    old, new = CHANGES[change]
    text = spec.read_text()
    assert old in text
    spec.write_text(text.replace(old, new, 1))
    asked = {"check": "full" if format == "text" else format}
    for verb in ("check", "data", "show", "validate"):
        words = [verb, SPEC, *(["--initial"] if verb == "validate" else [])]
        said = msnn(*words, "--format", asked.get(verb, format))
        assert "mistake of its own" not in said.err, said.err
        harmless(said.out, said.err)
    for words in (
        ("show", SPEC, "--resolved"),
        ("show", SPEC, "--latex"),
        ("diff", SPEC, "old.yaml"),
    ):
        (project / "old.yaml").write_text(text)
        said = msnn(*words)
        harmless(said.out, said.err)


@pytest.mark.parametrize("format", FORMATS)
def test_the_name_of_a_spec_stays_in_its_line(
    format: str, msnn: CommandLine, project: Path
) -> None:
    name = EVIL.replace("/", "") + ".msnn.yaml"
    broken = (project / SPEC).read_text().replace("epochs", "epoch")
    (project / name).write_text(broken)
    for words in (("check", "."), ("check", name), ("show", name), ("train", name), ("fmt", name)):
        formatted = ["--format", "full" if (words[0], format) == ("check", "text") else format]
        said = msnn(*words, *([] if words[0] == "fmt" else formatted))
        harmless(said.out, said.err)
    (project / name).write_text(broken.replace("epoch", "epochs") + "\n\n\n")
    for words in (("fmt", name), ("compare", name, "--set", "train.0.epochs=1", "--no-cost")):
        said = msnn(*words)
        assert said.code == 0, said.err
        harmless(said.out, said.err)


@pytest.mark.parametrize("format", FORMATS)
def test_files_and_columns_of_data_stay_in_their_line(
    format: str, msnn: CommandLine, project: Path
) -> None:
    log = sorted((project / "data" / "test").iterdir())[0]
    lines = log.read_text().splitlines()
    evil = log.with_name(EVIL + ".csv")
    quoted = EVIL.replace('"', '""')
    for changed in (
        [lines[0].replace("F", f'"{quoted}"'), *lines[1:]],
        [lines[0] + f',"{quoted}"', *(f"{line},1" for line in lines[1:])],
        [*lines[:3], lines[3].replace(",", f',"{quoted}"', 1), *lines[4:]],
    ):
        evil.write_text("\n".join(changed) + "\n")
        for words in (("data", SPEC), ("validate", SPEC, "--initial"), ("data", SPEC, "--data")):
            more = (str(evil.relative_to(project)),) if words[-1] == "--data" else ()
            said = msnn(*words, *more, "--format", format)
            assert "mistake of its own" not in said.err, said.err
            harmless(said.out, said.err)


@pytest.mark.parametrize(
    "words",
    [
        ("check", EVIL),
        ("train", SPEC, EVIL),
        (EVIL,),
        ("check", f"--{EVIL}"),
        ("train", SPEC, "--set", EVIL),
        ("train", SPEC, "--set", f"{EVIL}=1"),
        ("export", SPEC, "--to", EVIL),
        ("validate", SPEC, "--weights", EVIL),
        ("init", EVIL),
        ("explain", EVIL),
        ("report", EVIL),
        ("verify", EVIL),
        ("train", SPEC, "--out", f"{SPEC}/{EVIL}"),
    ],
)
def test_words_of_a_command_stay_in_their_line(words: tuple[str, ...], project: Path) -> None:
    """As a shell makes them of the files of a folder."""
    said = in_new_process(words, project)
    assert said.code not in (0, 70), said.err
    harmless(said.out, said.err)
