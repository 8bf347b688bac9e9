"""Every way in which a command can end has its code, one clear message and no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import msnn.cli.application
from msnn.cli.exit_codes import ExitCode
from msnn.errors.failures import MissingExtraError
from tests.cli.command_line import ROOT, CommandLine, in_new_process
from tests.cli.test_check import SPEC, change


def test_usage_errors_end_with_2(msnn: CommandLine):
    for arguments in (["nothing"], ["check"], ["train", SPEC, "--epochs", "3"], []):
        said = msnn(*arguments)
        assert said.code == ExitCode.USAGE
        assert said.out == "" or not arguments
    assert "Usage: msnn" in msnn("check").err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("export", "--initial", "--to", "c,foo"), "`foo` is none of torch, onnx, casadi, c"),
        (("export", "--initial", "--with", "hessian"), "`hessian` is none of jacobian"),
        (
            ("export", "--initial", "--to", "onnx", "--with", "jacobian"),
            "of all targets only c has `jacobian`",
        ),
        (("simulate", "a.csv"), "`a.csv` is more than `msnn simulate` takes: write `--data a.csv`"),
        (("simulate", "a.csv", "b.csv"), "write `--data` before each file of data"),
        (("show", "other"), "`other` is more than `msnn show` takes"),
        (("validate", "--set", "foo"), "`foo` is not a path, `=` and a value"),
        (("train", "--set", "=3"), "`=3` is not a path, `=` and a value"),
        (("simulate", "--plot", "a.xyz"), "`a.xyz` does not end with one of .png, .svg, .pdf"),
        (("validate", "--plot", "a.xyz"), "`a.xyz` does not end with one of .png, .svg, .pdf"),
        (("simulate", "--plot", "a"), "`a` does not end with one of .png, .svg, .pdf"),
        *(
            ((verb, "--initial", "--weights", "w.safetensors"), "'--initial'")
            for verb in ("validate", "simulate", "export")
        ),
    ],
)
def test_arguments_that_cannot_be_meant_are_usage_errors(
    msnn: CommandLine, project: Path, arguments: tuple[str, ...], message: str
):
    verb, *options = arguments
    said = msnn(verb, SPEC, *options)
    assert (said.code, said.out) == (ExitCode.USAGE, "")
    assert message in said.err
    assert f"Usage: msnn {verb}" in said.err


@pytest.mark.parametrize("option", ["-q", "--set=a=1", "--resume"])
def test_an_option_before_its_verb_is_told_its_place(msnn: CommandLine, option: str):
    said = msnn(option, "train", SPEC)
    assert (said.code, said.out) == (ExitCode.USAGE, "")
    assert f"`{option}` stands before its verb; write `msnn train {option}`" in said.err
    assert "No such option: --foo" in msnn("--foo").err


def test_version_and_help_end_with_0(msnn: CommandLine):
    assert msnn("--version").out.startswith("msnn ")
    said = msnn("--help")
    assert said.code == 0
    verbs = ("init", "check", "compile", "train", "validate", "simulate", "export", "show")
    assert all(f"  {verb} " in said.out for verb in verbs)


def test_a_bug_ends_with_70_and_one_sentence(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    def broken(*arguments: object) -> None:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr("msnn.reports.show.interface_text", broken)
    said = msnn("show", SPEC)
    assert said.code == ExitCode.BUG
    assert said.err == (
        "msnn met a mistake of its own (ZeroDivisionError: ours); `--verbose` shows where, "
        "please report it\n"
    )
    assert "Traceback" in msnn("show", SPEC, "--verbose").err


def test_a_missing_extra_ends_with_5_and_its_install_line(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    def missing() -> None:
        raise MissingExtraError("matplotlib, which draws plots,", "pip install 'msnn[plot]'")

    monkeypatch.setattr("msnn.reports.plotting.require_plotting", missing)
    said = msnn("simulate", SPEC, "--initial", "--plot", "a.png")
    assert said.code == ExitCode.MISSING_EXTRA
    assert said.err == (
        "error[E1037]: matplotlib, which draws plots, is not installed\n"
        " = help: pip install 'msnn[plot]'\n"
    )
    assert not (project / "simulation.csv").exists()


def test_a_compiler_that_is_not_there_ends_with_5(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("CC", "no-such-compiler")
    said = msnn("export", SPEC, "--initial", "--to", "c", "--check")
    assert said.code == ExitCode.MISSING_EXTRA
    assert "error[E1037]: a C compiler is not installed" in said.err


def test_a_target_that_fails_does_not_hide_the_table_of_the_others(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    def broken(*arguments: object) -> None:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr("msnn.exports.running.built_c.built_c", broken)
    said = msnn("export", SPEC, "--initial", "--to", "c,casadi", "--check")
    assert said.code == ExitCode.BUG
    assert "msnn met a mistake of its own (ZeroDivisionError: ours)" in said.err
    rows = {line.split()[0]: line.split()[-2:] for line in said.out.splitlines() if line.split()}
    assert rows["casadi"][-1] == "agrees"
    assert rows["c"] == ["FAILED:", "ZeroDivisionError"]


def test_a_folder_that_cannot_be_written_ends_with_1(msnn: CommandLine, project: Path):
    (project / "file").write_text("")
    said = msnn("compile", SPEC, "--out", "file/build")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E1033]: cannot use file/build" in said.err
    assert "Traceback" not in said.err


def test_a_reader_that_has_enough_is_no_error(project: Path):
    command = (
        f'"{sys.executable}" -c "from msnn.cli.main import main; main()" show --program {SPEC}'
    )
    found = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command} | head -n 1"],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (found.returncode, found.stderr) == (0, "")


@pytest.mark.parametrize("closed", ["<", "", "2"], ids=["stdin", "stdout", "stderr"])
@pytest.mark.parametrize("words", [f"check {SPEC}", "check -", "schema"])
def test_a_closed_stream_is_empty_and_takes_all(project: Path, words: str, closed: str):
    command = f'"{sys.executable}" -c "from msnn.cli.main import main; main()" {words}'
    shut = f"{closed}&-" if closed == "<" else f"{closed}>&-"
    found = subprocess.run(
        ["bash", "-c", f"{command} {shut}"],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        input="",
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == (ExitCode.DIAGNOSTICS if words == "check -" else ExitCode.OK)
    assert "Traceback" not in found.stderr
    assert "mistake of its own" not in found.stderr


def test_a_terminal_without_greek_gets_question_marks(project: Path):
    change(project, "k: {init: 10", "κ: {init: 10")
    change(project, "k*x", "κ*x")
    said = in_new_process(("show", SPEC), project, {"PYTHONIOENCODING": "ascii"})
    assert said.code == 0
    assert "?  " in said.out


_SIGNAL_AT_IMPORT = """
import os, sys
import msnn
from importlib.abc import MetaPathFinder

class SignalAtImport(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["SIGNAL_AT"]:
            os.kill(os.getpid(), int(os.environ["SIGNAL"]))

sys.meta_path.insert(0, SignalAtImport())
from msnn.cli.main import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "module", ["typer", "compiler.elaboration.compile", "numpy", "msnn.training.train"]
)
def test_interrupting_an_import_ends_with_130(project: Path, module: str, number: signal.Signals):
    environment = {"SIGNAL_AT": module, "SIGNAL": str(int(number))}
    said = in_new_process(("train", SPEC), project, environment, _SIGNAL_AT_IMPORT)
    assert (said.code, said.out, said.err) == (ExitCode.INTERRUPTED, "", "interrupted\n")


def test_an_interrupt_that_a_library_catches_ends_with_130(project: Path):
    """As in a callback of C, or where an import that fails is one of something optional."""
    start = _SIGNAL_AT_IMPORT.replace(
        'os.kill(os.getpid(), int(os.environ["SIGNAL"]))',
        "exec('try: os.kill(os.getpid(), 2)\\nexcept KeyboardInterrupt: pass')",
    )
    said = in_new_process(("check", SPEC), project, {"SIGNAL_AT": "msnn.model.load"}, start)
    assert (said.code, said.err) == (ExitCode.INTERRUPTED, "interrupted\n")


@pytest.mark.parametrize("place", ["msnn.project.package_names", "msnn.cli.main"])
@pytest.mark.parametrize("name", ["msnn", "other"])
def test_an_interrupt_before_main_listens_is_one_word(project: Path, place: str, name: str):
    """A program of another name that imports msnn ends as Python has it."""
    program = project / name
    program.write_text(
        "import os, sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {place!r}: os.kill(os.getpid(), 2)\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from msnn.cli.main import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, program, "check", SPEC],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    if name == "msnn":
        assert (done.returncode, done.stderr) == (ExitCode.INTERRUPTED, "interrupted\n")
    else:
        assert "Traceback" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupting_ends_with_130(project: Path, number: signal.Signals):
    change(project, "epochs: 80", "epochs: 100000")
    change(project, "patience: 20", "patience: 100000")
    start = [sys.executable, "-c", "from msnn.cli.main import main; main()", "train", SPEC]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        start, cwd=project, env=environment, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    lines = iter(process.stderr.readline, "")
    next(line for line in lines if "epoch 1/" in line)
    time.sleep(0.1)
    process.send_signal(number)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == ExitCode.INTERRUPTED
    assert f"this goes on: msnn train {SPEC} --resume\n" in rest
    assert "Traceback" not in rest
    assert list(project.glob("runs/plant/*/checkpoint.safetensors"))


def test_run_never_raises(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(msnn.cli.application, "application", interrupted)
    assert msnn.cli.application.run([]) == ExitCode.INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"
