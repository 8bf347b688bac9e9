"""What ends the comparison of one target does not keep the others from being compared."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from msnn.agreement.agreement import Agreement
from msnn.agreement.report import agreement_table, agreement_values
from msnn.cli.application import run
from msnn.cli.exit_codes import ExitCode
from msnn.errors.failures import MissingExtraError
from msnn.exports import check, export
from msnn.exports.check import check_exports
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.table import NAMES
from msnn.exports.target import AnyPlan, Weights, Written
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool

SPEC = """msnn: 1
name: m
sample_time: 10 ms
inputs: {u: {}}
states: {x: {der: u - x, init: 0}}
outputs: {y: x}
"""
ERRORS = [ZeroDivisionError("ours"), MissingExtraError("a tool", "apt install tool")]


class _NotImplemented(Exception):  # noqa: N818  (the name is onnxruntime's)
    """As onnxruntime has it: none of Python's."""


_NotImplemented.__name__ = "NotImplemented"


@pytest.mark.parametrize(
    "error", [NotImplementedError("no\n  kernel"), _NotImplemented("no kernel")]
)
@pytest.mark.parametrize("broken", ["onnx", "casadi", "fmu"])
def test_a_target_that_cannot_be_run_here_is_not_compared(
    broken: str,
    error: Exception,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    require_tool("gcc", install="apt install gcc")

    def loaded(plan: AnyPlan, written: Written) -> object:
        if plan.target.name == broken:
            raise error
        return load_export(plan, written)

    monkeypatch.setattr(check, "load_export", loaded)
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    words = ["export", str(spec), "--initial", "--check", "--out", str(tmp_path)]
    assert run([*words, "--to", f"c,{broken}"]) == ExitCode.MISSING_EXTRA
    said = capsys.readouterr()
    rows = {line.split()[0]: line for line in said.out.splitlines() if line.split()}
    assert rows["c"].endswith("agrees")
    assert rows[broken].endswith("not compared")
    assert f"error[E1133]: the {broken} export was written and not compared: no kernel" in said.err
    assert "Traceback" not in said.err


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("broken", [name for name in NAMES if name != "mpc"])
def test_a_target_that_fails_does_not_hide_the_others(
    broken: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt install gcc")

    def loaded(plan: AnyPlan, written: Written) -> object:
        if plan.target.name == broken:
            raise error
        return load_export(plan, written)

    monkeypatch.setattr(check, "load_export", loaded)
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    model = load_model(spec)
    plans = plan_exports(model, NAMES, Findings())
    exports = [(plan, write_export(plan, {}, tmp_path / plan.target.name)) for plan in plans]
    found = check_exports(model, exports, {}, tmp_path)
    others = [plan.target.name for plan in plans if plan.target.name != broken]
    assert [row.target for row in found.rows if row.agrees] == others
    assert [(failure.target, failure.error) for failure in found.failures] == [(broken, error)]
    lines = agreement_table(found).splitlines()[2:]
    assert [line.split()[0] for line in lines] == [*others, broken]
    assert json.loads(json.dumps(agreement_values(found)))["not_checked"] == [str(error)]


def test_a_target_that_cannot_be_written_keeps_no_other_from_being_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def written(plan: AnyPlan, weights: Weights, folder: Path) -> Written:
        if plan.target.name == "torch":
            raise MissingExtraError("a tool", "apt install tool")
        return write_export(plan, weights, folder)

    monkeypatch.setattr(export, "write_export", written)
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    code = run(["export", str(spec), "--to", "torch,casadi", "--check", "-o", str(tmp_path / "x")])
    said = capsys.readouterr()
    assert code == ExitCode.MISSING_EXTRA
    assert "error[E1037]: a tool is not installed" in said.err
    assert said.out.splitlines()[-1].split()[::6] == ["casadi", "agrees"]


@pytest.mark.parametrize("target", ["c", "fmu"])
def test_a_library_that_does_not_link_is_named(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sources compile, so that the compiler counts as installed: the linker's words say more."""
    require_tool("gcc", install="apt install gcc")
    monkeypatch.setenv("CC", "gcc -lno-such-library")
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    code = run(["export", str(spec), "--to", target, "--check", "-o", str(tmp_path / "x")])
    _, message, *more = capsys.readouterr().err.splitlines()
    assert code == ExitCode.MISSING_EXTRA
    assert message.startswith("error[E1132]: `gcc -lno-such-library` did not build the export: ")
    assert "cannot find -lno-such-library" in message
    assert more == [" = help: cure what it complains of, or set CC to another compiler"]


def test_a_compiler_that_does_not_end_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o700)
    monkeypatch.setenv("CC", str(slow))
    monkeypatch.setenv("MSNN_COMPILER_SECONDS", "0.2")
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    code = run(["export", str(spec), "--to", "c", "--check", "-o", str(tmp_path / "x")])
    said = capsys.readouterr().err
    assert code == ExitCode.MISSING_EXTRA
    assert f"error[E1132]: `{slow}` did not build the export: it did not end within 0.2 s" in said
    assert "MSNN_COMPILER_SECONDS" in said


def test_a_record_that_fails_is_a_failure_of_its_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object) -> None:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(check, "agreement_record", broken)
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC)
    model = load_model(spec)
    (plan,) = plan_exports(model, ["torch"], Findings())
    written = write_export(plan, {}, tmp_path / "torch")
    found = check_exports(model, [(plan, written)], {}, tmp_path)
    assert found.first_error is not None
    assert not found.rows


def test_a_target_that_draws_its_samples_reads_no_data(tmp_path: Path) -> None:
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC + "data: {source: {train: none.csv}}\n")
    model = load_model(spec)
    (plan,) = plan_exports(model, ["c"], Findings())
    same = Agreement(
        target="c",
        dtype="float32",
        steps=1,
        one_step=None,
        free_run=0.0,
        jacobian=None,
        bits=None,
        faults=(),
        undecided={},
        untried=(),
        rounding={},
    )
    drawing = replace(plan, target=replace(plan.target, compare=lambda *_: same))
    found = check_exports(model, [(drawing, Written(tmp_path, ()))], {}, tmp_path)
    assert (found.origin, found.rows, found.failures) == ("drawn samples", (same,), ())
