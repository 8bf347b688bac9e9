"""What every verb can be asked for: to say less or more, to write to a file, to fit a terminal."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pytest

from msnn.cli import output_options
from msnn.cli.application import VERBS
from msnn.tables import LINE_WIDTH, table_text
from tests.cli.command_line import CommandLine, in_new_process
from tests.cli.test_check import SPEC, change

WARNED = "F: {unit: N, range: [-10, 10], between: hold, doc: force on the mass}"
UNUSED = f"{WARNED}\n  w: {{unit: N}}"


def test_quiet_leaves_results_and_errors(msnn: CommandLine, project: Path):
    change(project, WARNED, UNUSED)
    loud = msnn("check", SPEC)
    assert "warning[" in loud.err
    said = msnn("check", SPEC, "-q")
    assert (said.code, said.out, said.err) == (0, loud.out, "")
    change(project, "k*x", "kk*x")
    assert msnn("check", SPEC, "--quiet").err.startswith("error[E0301]")


def test_a_quiet_training_says_no_progress(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--set", "train.0.epochs=1", "-q")
    assert said.code == 0
    assert said.err == ""
    assert "kept in runs" in said.out


def test_verbose_adds_remarks_and_the_time(msnn: CommandLine, project: Path):
    change(project, ", between: hold", "")
    assert "remark" not in msnn("show", SPEC).err
    said = msnn("show", SPEC, "-v").err
    assert "W0748" in said
    assert said.splitlines()[-1].startswith("took ")
    assert "took" not in msnn("show", SPEC).err, "the next command is asked anew"


def test_quiet_and_verbose_exclude_each_other(msnn: CommandLine, project: Path):
    said = msnn("check", SPEC, "-q", "-v")
    assert said.code == 2
    assert "'--quiet': excludes `--verbose`" in said.err


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_them(msnn: CommandLine, verb: str):
    said = msnn(verb, "--help")
    assert said.code == 0
    for option in ("-q, --quiet", "-v, --verbose", "-o, --"):
        assert option in said.out or (option == "-o, --" and verb in ("init", "fmt")), option


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("validate", SPEC, "--engine", "native", "--engine", "torch"), "--engine"),
        (("train", SPEC, "-o", "a", "--out", "b"), "--out"),
        (("show", SPEC, "-oa", "-ob"), "--output"),
        (("check", SPEC, "--format", "json", "--format", "text"), "--format"),
    ],
)
def test_an_option_of_one_value_takes_one(
    msnn: CommandLine, project: Path, words: tuple[str, ...], option: str
):
    said = msnn(*words)
    assert said.code == 2
    assert f"`{option}` is given 2 times, and takes one value" in said.err


def test_flags_and_options_of_many_values_may_be_repeated(msnn: CommandLine, project: Path):
    settings = ("--set", "parameters.m.init=2", "--set", "train.0.epochs=1")
    assert msnn("show", SPEC, "-q", "-q", *settings).code == 0


def test_options_of_several_words_are_joined(msnn: CommandLine, project: Path):
    out = ("--initial", "--out", "out")
    assert msnn("export", SPEC, *out, "--to", "c", "--to=fmu,c", "--with", "jacobian").code == 0
    assert {path.name for path in (project / "out").iterdir()} == {"c", "fmu"}
    said = msnn("export", SPEC, *out, "--to", "c", "--with", "ros2", "--with", "nothing")
    assert said.code == 2
    assert "`nothing` is none of" in said.err
    change = ("diff", SPEC, SPEC, "--set-new", "parameters.m.init=2")
    assert msnn(*change, "--fail-on", "never", "--fail-on", "breaking").code == 0
    assert msnn(*change, "--fail-on", "any", "--fail-on", "never").code == 1
    assert msnn(*change).code == 1
    for wrong in ("worst", ""):
        said = msnn(*change, "--fail-on", "any" if wrong else "", "--fail-on", wrong)
        assert said.code == 2
        assert f"`{wrong}` is none of any, breaking, worse, never" in said.err
    said = msnn("verify", "out/c", "--targets", "host", "--targets", "moon")
    assert said.code == 2
    assert "`moon` is none of" in said.err


def test_the_result_goes_to_a_file(msnn: CommandLine, project: Path):
    shown = msnn("show", SPEC)
    said = msnn("show", SPEC, "-o", "interface.txt")
    assert (said.code, said.out) == (0, "")
    assert (project / "interface.txt").read_text() == shown.out


def test_a_dash_is_standard_output(msnn: CommandLine, project: Path):
    assert msnn("show", SPEC, "-o", "-").out == msnn("show", SPEC).out
    assert not (project / "-").exists()


def test_a_result_that_says_what_is_wrong_is_written_too(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    said = msnn("check", SPEC, "--format", "sarif", "--output", "found.sarif")
    assert (said.code, said.out) == (1, "")
    (run,) = json.loads((project / "found.sarif").read_text())["runs"]
    assert [result["ruleId"] for result in run["results"]] == ["E0301"]


def test_a_file_that_cannot_be_written_ends_with_1(msnn: CommandLine, project: Path):
    (project / "folder").mkdir()
    said = msnn("show", SPEC, "-o", "folder")
    assert said.code == 1
    assert "folder" in said.err


def test_a_command_line_that_is_wrong_writes_no_file(msnn: CommandLine, project: Path):
    assert msnn("show", SPEC, "-o", "a.txt", "--nope").code == 2
    assert not (project / "a.txt").exists()


def test_folders_are_searched_for_specs(msnn: CommandLine, project: Path):
    for folder in ("more/deep", "runs/old", ".hidden"):
        (project / folder).mkdir(parents=True)
        (project / folder / "broken.msnn.yaml").write_text("msnn: 2\n")
    (project / "more" / "notes.yaml").write_text("no spec\n")
    said = msnn("check", ".", "--format", "concise")
    assert said.code == 1
    assert {line.partition(":")[0] for line in said.err.splitlines()} == {
        "more/deep/broken.msnn.yaml"
    }
    assert said.out.startswith("plant: ")


def test_a_folder_without_specs_is_a_wrong_command_line(msnn: CommandLine, project: Path):
    (project / "empty").mkdir()
    said = msnn("check", "empty")
    assert said.code == 2
    assert "`empty` has no file that ends with .msnn.yaml" in said.err


def test_standard_input_is_checked(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    text = (project / SPEC).read_text()
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    assert msnn("check", "-").out == msnn("check", SPEC).out
    monkeypatch.setattr("sys.stdin", io.StringIO(text.replace("k*x", "kk*x")))
    said = msnn("check", "-", "--format", "concise")
    assert said.err == "<stdin>:23:17: error[E0301]: unknown name `kk`\n"


def test_a_table_that_is_wider_than_the_terminal_goes_on_below():
    header, rows = ("name", "first", "second", "third"), [("a", "1" * 10, "2" * 10, "3" * 10)]
    token = LINE_WIDTH.set(30)
    try:
        folded = table_text(header, rows)
    finally:
        LINE_WIDTH.reset(token)
    assert folded.split("\n\n") == [
        "name  first       second\na     1111111111  2222222222",
        "name  third\na     3333333333",
    ]
    assert "\n\n" not in table_text(header, rows)


def test_tables_are_folded_on_terminals_alone(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.stdout", io.StringIO())
    assert output_options.terminal_width() is None
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "72")
    assert output_options.terminal_width() == 72


def test_a_shell_completes_verbs_and_options(tmp_path: Path):
    asked = {"_MSNN_COMPLETE": "complete_bash", "COMP_CWORD": "1", "COMP_WORDS": "msnn tr"}
    start = "from msnn.cli.main import main; main()"
    said = in_new_process([], tmp_path, {**os.environ, **asked}, start)
    assert said.out.split() == ["train"]
    asked |= {"COMP_CWORD": "2", "COMP_WORDS": "msnn train --res"}
    assert in_new_process([], tmp_path, {**os.environ, **asked}, start).out.split() == ["--resume"]


def test_the_version_in_short(msnn: CommandLine):
    assert msnn("-V").out == msnn("--version").out
