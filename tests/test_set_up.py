"""Set-up: a stamp stands for a finished step, and the lock pins all that the project asks for."""

import re
import tomllib
from itertools import chain
from pathlib import Path
from types import ModuleType

import pytest

from tests.ci.scripts import script

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def set_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The set-up script as a module, working on an empty environment."""
    module = script("set_up", monkeypatch)
    monkeypatch.setattr(module, "ENVIRONMENT", tmp_path)
    return module


def test_a_finished_step_runs_once_for_a_key(set_up: ModuleType):
    runs: list[str] = []
    for key in ["old", "old", "new", "new"]:
        set_up.once("step", key, lambda key=key: runs.append(key))
    assert runs == ["old", "new"]


def test_an_interrupted_step_runs_again(set_up: ModuleType):
    """Also where an older stamp of the same key stood before a step that failed."""
    runs: list[str] = []

    def interrupt() -> None:
        raise KeyboardInterrupt

    set_up.once("step", "old", lambda: runs.append("old"))
    with pytest.raises(KeyboardInterrupt):
        set_up.once("step", "new", interrupt)
    set_up.once("step", "old", lambda: runs.append("old again"))
    assert runs == ["old", "old again"]


def test_another_python_is_named(set_up: ModuleType):
    with pytest.raises(set_up.SetUpError, match=r"made for Python 3\.11 and this is 3\.10\.4"):
        set_up.check_python((3, 10, 4))


def test_without_pip_and_rights_the_line_to_run_is_given(
    set_up: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(set_up, "has", lambda module: False)
    monkeypatch.setattr(set_up, "administrator", lambda: None)
    assert set_up.main() == 2
    assert capsys.readouterr().err == (
        "set-up: this Python has neither pip nor ensurepip; "
        "run: sudo apt-get install python3.11-venv\n"
    )


def test_the_lock_pins_every_requirement_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    asked = [
        *project["build-system"]["requires"],
        *project["project"]["dependencies"],
        *chain.from_iterable(project["project"]["optional-dependencies"].values()),
        *project["dependency-groups"]["dev"][1:],
        *project["dependency-groups"]["docs"],
    ]
    names = {re.split(r"[\[<>=~! ]", requirement)[0] for requirement in asked}
    assert names - {"msnn"} <= set(locked_blocks())  # the extra `all` names the others


def test_the_lock_has_a_hash_for_every_package_and_no_address():
    for name, block in locked_blocks().items():
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", block), name
    text = (ROOT / "requirements.lock").read_text()
    assert "://" not in text
    assert not re.search(r"^-", text, flags=re.MULTILINE), "the lock must set no pip option"


def locked_blocks() -> dict[str, str]:
    """Each pinned package with its lines of the lock."""
    text = (ROOT / "requirements.lock").read_text()
    blocks = re.split(r"^(?=[a-z0-9])", text, flags=re.MULTILINE)[1:]
    return {block.partition("==")[0].strip(): block for block in blocks}
