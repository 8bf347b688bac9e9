"""A test that misses something on the machine is skipped for a user and fails in CI."""

from pathlib import Path

import pytest

from tests.conditions import require_folder, require_tool


def test_a_tool_that_is_there_is_returned():
    assert Path(require_tool("sh", install="apt install dash")).name == "sh"


def test_a_missing_tool_skips_for_a_user(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="no-such-tool is not installed: apt install x"):
        require_tool("no-such-tool", install="apt install x")


def test_a_missing_tool_fails_in_ci(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="apt install x"):
        require_tool("no-such-tool", install="apt install x")


def test_a_missing_folder_skips_or_fails(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    assert require_folder(tmp_path) == tmp_path
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception):
        require_folder(tmp_path / "absent")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception):
        require_folder(tmp_path / "absent")
