"""Every code block of the documentation runs, or says by a comment why it does not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conditions import require_tool
from tests.docs.blocks import Block, blocks_of, indented_code, unseen_code
from tests.docs.page_run import ROOT, PageRun
from tests.golden import assert_golden

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*/README.md")),
]


def _named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def _own(page: Path) -> list[Block]:
    return [block for block in blocks_of(page) if not block.is_generated]


@pytest.mark.parametrize("page", PAGES, ids=_named)
def test_no_code_stands_without_a_fence(page: Path):
    lines = indented_code(page)
    assert not lines, f"{_named(page)}: put ``` around the code of lines {lines}"


@pytest.mark.parametrize("page", PAGES, ids=_named)
def test_all_code_is_seen(page: Path):
    lines = unseen_code(page)
    assert not lines, f"{_named(page)}: give lines {lines} a fence ``` after blanks alone"


@pytest.mark.parametrize("page", [page for page in PAGES if _own(page)], ids=_named)
def test_every_block_runs_or_says_what_it_is(page: Path, quick: Path, tmp_path: Path, accept: bool):
    require_tool("gcc", install="apt install gcc")
    folder, home = tmp_path / "clean", tmp_path / "home"
    folder.mkdir()
    home.mkdir()
    run = PageRun(page, folder, home, quick)
    for block in _own(page):
        run.run(block)
    if accept:
        _write(page, run.printed)
    _compare_pictures(page, folder, accept=accept)
    assert not run.faults, "\n".join(run.faults)


def _compare_pictures(page: Path, folder: Path, *, accept: bool):
    """What a command of the page has drawn is the picture that the page shows."""
    for name in re.findall(r"\]\(figures/([\w.]+)\)", page.read_text(encoding="utf-8")):
        drawn = folder / name
        if drawn.is_file():
            assert_golden(page.parent / "figures" / name, drawn.read_text("utf-8"), accept)


def _write(page: Path, printed: dict[tuple[int, int], str]) -> None:
    text = page.read_text(encoding="utf-8")
    for (start, end), now in sorted(printed.items(), reverse=True):
        text = text[:start] + now + text[end:]
    page.write_text(text, encoding="utf-8")
