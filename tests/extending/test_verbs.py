"""A verb of a plug-in runs, fails and is listed as ours are; a fault of it is its package's."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.cli.application import run
from spec_schema import plugins
from tests.extending.conftest import Install
from tests.extending.test_plugins import PLAIN, spec_file

RECORD = """
import sys
from pathlib import Path
from typing import Annotated

import typer
from msnn.extending import *

def weigh(file: Path = Path("none"), {value}: {kind} = None):
    {body}

def count():
    note("counted")
    result("3")

APP = typer.Typer(help="Two verbs.")
APP.command()(weigh)
APP.command()(count)
FEATURE = Feature(
    name="scale", verbs=(VerbLine("{name}", "Weigh it.", LateObject("scale", "{command}")),)
)
"""

Scale = Callable[..., None]


@pytest.fixture
def scale(install: Install):
    """Installs the package `scale`, whose verb has this body."""

    def installed(
        body: str = "pass",
        name: str = "weigh",
        command: str = "weigh",
        kind: str = "str",
        value: str = "value",
    ) -> None:
        text = RECORD.format(body=body, name=name, command=command, kind=kind, value=value)
        install("scale", {"scale.py": text}, "scale:FEATURE")

    return installed


@pytest.mark.usefixtures("example")
def test_a_verb_of_a_plugin_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = str(spec_file(tmp_path, PLAIN))
    assert run(["operations", file]) == 0
    shown = capsys.readouterr().out
    assert "Multiply         1" in shown
    assert run(["operations", file, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["command"], record["operations"]["Multiply"]) == ("operations", 1)
    assert run(["operations", file, "-o", str(tmp_path / "counts.txt")]) == 0
    assert (tmp_path / "counts.txt").read_text() == shown


@pytest.mark.usefixtures("example")
def test_its_help_is_that_of_a_command(capsys: pytest.CaptureFixture[str]):
    assert run(["operations", "--help"]) == 0
    said = capsys.readouterr().out
    assert "Usage: msnn operations [OPTIONS]" in said
    assert "Count the operations of a step by kind." in said
    assert "-q, --quiet" in said


@pytest.mark.usefixtures("example")
def test_verbs_of_plugins_are_a_group_of_their_own(capsys: pytest.CaptureFixture[str]):
    assert run(["--help"]) == 0
    ours, _, theirs = capsys.readouterr().out.partition("\nPlug-ins:\n")
    assert "operations" not in ours
    assert "  operations  Count the operations of a step by kind (msnn-example 0.1.0)\n" in theirs


@pytest.mark.usefixtures("install")
def test_without_plugins_there_is_no_group(capsys: pytest.CaptureFixture[str]):
    assert run(["--help"]) == 0
    assert "Plug-ins" not in capsys.readouterr().out


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["operations"], 2, "Missing argument 'SPEC'"),
        (["operations", "m.msnn.yaml", "more"], 2, "`more` is more than `msnn operations` takes"),
        (["operations", "none.msnn.yaml"], 1, "error[E1001]: cannot read none.msnn.yaml"),
        (["operatoins"], 2, "No such command 'operatoins'. Did you mean 'operations'?"),
        (["nothing"], 2, "No such command 'nothing'."),
        (["trian"], 2, "No such command 'trian'. Did you mean 'train'?"),
    ],
)
def test_mistakes_of_the_user_are_messages_as_ours_are(
    words: list[str], code: int, message: str, capsys: pytest.CaptureFixture[str]
):
    assert run(words) == code
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("body", "code", "message"),
    [
        ("raise SpecError([error('SCALE1', None, 'too heavy')])", 1, "error[SCALE1]: too heavy\n"),
        ("report([warning('SCALE2', None, 'heavy')], ())", 0, "warning[SCALE2]: heavy\n\n"),
        ("raise MissingExtraError('a scale', 'buy one')", 5, "error[E1037]: a scale is not inst"),
        ("raise typer.BadParameter('too long')", 2, "Invalid value: too long"),
        ("raise typer.Exit(ExitCode.LIMIT_BROKEN)", 3, ""),
        ("file.read_text()", 1, "error[E1033]: cannot use none: no such file or directory"),
        ("sys.exit('no pan')", 1, "no pan\n"),
        ("sys.exit(256)", 1, ""),
        ("sys.exit()", 0, ""),
        ("return ExitCode.LIMIT_BROKEN", 3, ""),
        ("return 0", 0, ""),
        ("Path('none', 'x').read_text()", 1, "error[E1033]: cannot use none/x"),
        ("raise KeyboardInterrupt", 130, "interrupted\n"),
    ],
)
def test_a_verb_ends_as_ours_do(
    body: str,
    code: int,
    message: str,
    scale: Scale,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    scale(body)
    assert run(["weigh"]) == code
    said = capsys.readouterr().err
    assert message in said
    assert "scale 0.1.0" not in said


@pytest.mark.parametrize(
    ("faulty", "reason"),
    [
        ({"body": "{}['pan']"}, "KeyError: 'pan'"),
        ({"body": "raise MemoryError"}, "MemoryError);"),
        ({"body": "open('/no/settings')"}, "FileNotFoundError: [Errno 2] No such file"),
        ({"body": "raise OSError('no scale')"}, "OSError: no scale"),
        (
            {"body": "raise SpecError([])"},
            "raised a SpecError without an error: write `SpecError([",
        ),
        ({"body": "raise SpecError([warning('A1', None, 'x')])"}, "raised a SpecError without an"),
        ({"body": "return 'heavy'"}, "returned a str: return an `ExitCode` or nothing"),
        ({"body": "return True"}, "returned a bool: "),
        ({"body": "return 77"}, "returned a int: "),
        (
            {"value": "quiet"},
            "its parameter `quiet` has the option `--quiet` of every verb: rename",
        ),
        ({"value": "verbose"}, "its parameter `verbose` has the option `--verbose` of every verb"),
        ({"value": "be_quiet"}, "ValueError: "),
        (
            {"kind": "Annotated[str, typer.Option('-o')]"},
            "its parameter `value` has the option `-o`",
        ),
        (
            {"kind": "Annotated[Path, typer.Option('--file')]"},
            "its parameter `value` has the option `--file` of `file`: rename it",
        ),
        ({"body": "raise ValueError('no\\x1b[31m pan')"}, "ValueError: no"),
        # typer refuses the types when it builds the command
        ({"kind": "int | str"}, "AssertionError: Typer currently doesn't support Union types"),
    ],
)
def test_a_fault_of_a_verb_is_one_of_its_package(
    faulty: dict[str, str], reason: str, scale: Scale, capsys: pytest.CaptureFixture[str]
):
    scale(**faulty)
    assert run(["weigh"]) == 70
    said = capsys.readouterr().err
    assert said.startswith(f"the verb `weigh` of the plug-in scale 0.1.0 failed ({reason}")
    assert "report it to the authors of scale" in said
    assert "mistake of its own" not in said
    assert "\x1b" not in said
    assert "Traceback" not in said
    assert run(["weigh", "--verbose"]) == 70
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "the plug-in scale 0.1.0 failed" in said
    # the others are listed and completed anyway
    assert run(["--help"]) == 0
    assert "weigh  Weigh it (scale 0.1.0)" in capsys.readouterr().out


def test_a_verb_may_have_verbs(scale: Scale, capsys: pytest.CaptureFixture[str]):
    scale(command="APP", name="scale-pan", body="raise ValueError('pan')")
    for _ in range(2):
        assert run(["scale-pan", "count", "--quiet"]) == 0
        assert capsys.readouterr() == ("3\n", "")
        assert run(["scale-pan", "weigh"]) == 70
        assert "the verb `scale-pan` of the plug-in scale 0.1.0" in capsys.readouterr().err
    assert run(["scale-pan", "--help"]) == 0
    said = capsys.readouterr().out
    assert "Weigh it." in said
    assert "install-completion" not in said


@pytest.mark.parametrize(
    "name", ["train", "import", "doctor", "operations", "a b", "--x", "", "x."]
)
def test_a_name_that_is_taken_is_left_out(
    name: str, example: None, scale: Scale, capsys: pytest.CaptureFixture[str]
):
    scale(name=name, body="raise ValueError('replaced')")
    (warning,) = plugins.look_up().warnings
    assert warning.code == "W0222"
    assert f"the verb `{name}` of the package scale is left out" in warning.message
    assert run([name, "--help"]) == (0 if name.isalpha() else 2)
    assert run(["--help"]) == 0
    said = capsys.readouterr()
    assert f"the verb `{name}` of the package scale is left out" in said.err
    assert "(scale 0.1.0)" not in said.out


def test_an_unknown_verb_names_the_plugins_that_do_not_work(
    install: Install, capsys: pytest.CaptureFixture[str]
):
    install("scale", {"scale.py": "raise ValueError('no licence')"}, "scale:FEATURE")
    assert run(["weigh"]) == 2
    said = capsys.readouterr().err
    assert "of the package scale is left out: ValueError: no licence" in said
    assert "No such command 'weigh'." in said


@pytest.mark.parametrize(
    ("kind", "line", "offered"),
    [
        ("str", "msnn we", "weigh"),
        ("str", "msnn weigh --q", "--quiet"),
        ("int | str", "msnn we", ""),
        ("int | str", "msnn va", "validate"),
    ],
)
def test_shells_complete_it(
    kind: str,
    line: str,
    offered: str,
    scale: Scale,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    scale(kind=kind)
    monkeypatch.setenv("_MSNN_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    assert run([]) == 0
    assert capsys.readouterr() == (f"{offered}\n" if offered else "\n", "")
