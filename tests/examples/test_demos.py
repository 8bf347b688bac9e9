"""Demos end with the code of a command that failed, and go on after a broken limit of a spec."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def demo(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The demo of the example that a test names, with modules beside it forgotten in the end."""
    folder = EXAMPLES / request.param
    beside = [path.stem for path in folder.glob("*.py")]
    for name in beside:
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(str(folder))
    yield importlib.import_module("demo")
    for name in beside:
        sys.modules.pop(name, None)


def ends_with(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every command that a demo runs ends at once."""

    def ended(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, code, stdout="what it says")

    monkeypatch.setattr(subprocess, "run", ended)


@pytest.mark.parametrize("demo", ["vehicle_steering"], indirect=True)
def test_only_a_validation_of_the_steering_may_end_with_3(
    demo: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ends_with(0, monkeypatch)
    assert demo.limits_hold("mlp.msnn.yaml")
    assert "limit" not in capsys.readouterr().out
    ends_with(3, monkeypatch)
    assert not demo.limits_hold("mlp.msnn.yaml")
    assert "a limit of mlp.msnn.yaml is broken" in capsys.readouterr().out
    for arguments in (("train", "x.yaml"), ("export", "x.yaml", "--check"), ("verify", "c")):
        with pytest.raises(SystemExit) as ended:
            demo.msnn(*arguments)
        assert ended.value.code == 3
    ends_with(1, monkeypatch)
    with pytest.raises(SystemExit):
        demo.limits_hold("mlp.msnn.yaml")


@pytest.mark.parametrize("demo", ["vehicle_steering"], indirect=True)
def test_what_a_failed_command_says_of_itself_as_json_is_shown(
    demo: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ends_with(3, monkeypatch)
    with pytest.raises(SystemExit):
        demo.msnn("verify", "c", "--format", "json")
    assert "what it says" in capsys.readouterr().out


@pytest.mark.parametrize("demo", ["z1_friction"], indirect=True)
def test_only_a_validation_of_the_arm_may_end_with_3(
    demo: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    validate = ("-m", "msnn", "validate", demo.ARM)
    ends_with(0, monkeypatch)
    assert demo.run(validate, {})
    assert "limit" not in capsys.readouterr().out
    ends_with(3, monkeypatch)
    assert not demo.run(validate, {})
    assert "a limit is broken" in capsys.readouterr().out
    for command in (("-m", "msnn", "verify", "c"), ("-m", "msnn", "train", "x"), ("control.py",)):
        with pytest.raises(SystemExit) as ended:
            demo.run(command, {})
        assert ended.value.code == 3
    ends_with(0, monkeypatch)
    monkeypatch.setattr(sys, "argv", ["demo.py"])
    assert demo.main() == 0
    ends = {True: 3, False: 0}

    def only_validation_breaks(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, ends["validate" in command], stdout="")

    monkeypatch.setattr(subprocess, "run", only_validation_breaks)
    assert demo.main() == 3
    assert capsys.readouterr().out.endswith("is broken: see `msnn validate` above\n")


@pytest.mark.parametrize("demo", ["mpc_tank"], indirect=True)
def test_only_a_validation_of_the_tanks_may_end_with_3(
    demo: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ends_with(0, monkeypatch)
    assert demo.command_line("validate", "tank.msnn.yaml")
    assert "limit" not in capsys.readouterr().out
    ends_with(3, monkeypatch)
    assert not demo.command_line("validate", "tank.msnn.yaml")
    assert "a limit is broken" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        demo.command_line("export", "tank.msnn.yaml", "--check")
    assert ended.value.code == 3
