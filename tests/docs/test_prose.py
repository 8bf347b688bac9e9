"""The prose check of `make lint` finds the words and sentences that it is for, and no others."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs.page_run import ROOT


@pytest.fixture(scope="module")
def prose() -> ModuleType:
    spec = importlib.util.spec_from_file_location("prose", ROOT / ".ci" / "prose.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["prose"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


LONG = " ".join(["word"] * 31)


@pytest.mark.parametrize(
    ("sentence", "fault"),
    [
        ("The slope of the loss is zero.", "`slope`"),
        ("What simulates runs here.", "starts with `What`"),
        ("Whether it is open.", "starts with `Whether`"),
        ("A record is read in place of a spec.", "`in place of`"),
        ("It is told at once.", "`is told`"),
        (f"{LONG}.", "31 words"),
    ],
)
def test_a_sentence_of_the_private_dialect_is_found(prose: ModuleType, sentence: str, fault: str):
    (found,) = prose.findings("docs/page.md", f"# Title\n\nFine. {sentence}\n")
    assert found.fault.startswith(fault)
    assert found.sentence == sentence
    assert found.line == 3


@pytest.mark.parametrize(
    "text",
    [
        "What is a window?",
        "The gradient of `slope` is zero.",
        "# What is where",
        "| slope | a cell of a table |",
        "<!-- figures given: the slope -->",
        "```yaml\nslope: 3\n```",
        "See [the derivative](slopes.md).",
        "One sentence. " * 20,
    ],
)
def test_code_titles_and_tables_are_left_alone(prose: ModuleType, text: str):
    assert list(prose.findings("docs/page.md", f"{text}\n")) == []


def test_docstrings_and_messages_of_modules_are_read(prose: ModuleType):
    text = '"""Whether it runs."""\n\nX = "its slope"\n'
    assert [found.line for found in prose.findings("msnn/errors/a.py", text)] == [1, 3]
    assert [found.line for found in prose.findings("msnn/data/a.py", text)] == [1]


def test_the_check_fails_at_a_new_sentence_and_not_at_a_known_one(
    prose: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    folder, known = tmp_path / "repository", tmp_path / "known.txt"
    (folder / "docs").mkdir(parents=True)
    page = folder / "docs" / "page.md"
    page.write_text("It is told.\n", encoding="utf-8")
    known.write_text("", encoding="utf-8")
    monkeypatch.setattr(prose, "ROOT", folder)
    monkeypatch.setattr(prose, "KNOWN", known)
    monkeypatch.setattr(sys, "argv", ["prose.py"])
    assert prose.main() == 1
    printed = capsys.readouterr().out
    assert "docs/page.md:1: `is told`" in printed
    known.write_text(printed.partition("[")[2].partition("]")[0], encoding="utf-8")
    assert prose.main() == 0
    page.write_text("It is reported.\n", encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["prose.py", "--shrink"])
    assert prose.main() == 0
    assert known.read_text(encoding="utf-8") == ""
