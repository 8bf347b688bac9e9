"""Figures that a page has of a measurement are those of the file that the measurement writes.

`figures` has the comments by which a page says where its figures are from. A figure of which it
says nothing is refused: it would stay when what it tells of has changed.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.docs.figures import Passage, not_measured, passages_of
from tests.docs.page_run import ROOT

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
    *sorted((ROOT / "examples").glob("*/README.md")),
    ROOT / "editors" / "vscode" / "README.md",
]
"""All but decisions, which tell of their day."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_figure_says_where_it_is_from(page: Path):
    faults = [fault for passage in passages_of(page) for fault in _faults(page, passage)]
    assert not faults, "\n".join(faults)


def _faults(page: Path, passage: Passage) -> list[str]:
    place = f"{page.relative_to(ROOT)}:{passage.line}"
    match passage.kind:
        case "of" if passage.about == "links":
            rows = [replace(passage, text=row) for row in passage.text.split("\n")]
            return [fault for row in rows if row.figures for fault in _row_faults(page, row, place)]
        case "of":
            results = (page.parent / passage.about).read_text(encoding="utf-8")
            unknown = not_measured(passage.text, results)
            return [f"{place}: {passage.about} does not have {unknown}"] if unknown else []
        case "by":
            test = ROOT / passage.about
            named = page.parent.name if page.name == "README.md" else page.name
            is_test = test.is_file() and named in test.read_text(encoding="utf-8")
            return [] if is_test else [f"{place}: {passage.about} is no test of this page"]
        case "given":
            return [] if passage.figures else [f"{place}: has no figure that needs a comment"]
        case _:
            unsaid = passage.figures
            return [f"{place}: where are {unsaid} from? (tests/docs/figures.py)"] if unsaid else []


def _row_faults(page: Path, row: Passage, place: str) -> list[str]:
    """Figures of a row of a table are in the files that the row links to."""
    linked = re.findall(r"\]\(([^)#:]+\.(?:md|json))(?:#[^)]*)?\)", row.text)
    results = "\n".join((page.parent / file).read_text(encoding="utf-8") for file in linked)
    unknown = not_measured(row.text, results)
    return [f"{place}: {linked or 'no file'} does not have {unknown}"] if unknown else []


def test_a_row_has_the_figures_of_the_file_that_it_links(tmp_path: Path):
    (tmp_path / "a.md").write_text("1.5 ms\n", encoding="utf-8")
    (tmp_path / "b.md").write_text("2.5 ms\n", encoding="utf-8")
    page = tmp_path / "page.md"
    row = Passage("| [one](a.md#x) | 1.5 ms |\n| [two](b.md) | 1.5 ms |", 1, "of", "links")
    rows = [replace(row, text=text) for text in row.text.split("\n")]
    assert [bool(_row_faults(page, each, "page.md")) for each in rows] == [False, True]
    assert _row_faults(page, replace(row, text="| no link | 1.5 ms |"), "page.md")


def test_a_figure_that_was_not_measured_is_named():
    results = "damping 28.335 and 1.9e-06, 200 times, 4,711 bytes"
    assert not_measured("28.3 of [200](a%2031.md) `77`, 28, 4711, 4,711 and 2e-06", results) == []
    assert not_measured("28.4, 201 times or -200", results) == ["28.4", "201", "-200"]
    assert not_measured("28.3s, 200x, 4,711bytes and 2 of float32 in M4F", results) == ["2"]
    assert not_measured("30ms, 1.75s, 1.7x, 3GiB", results) == ["30", "1.75", "1.7", "3"]


@pytest.mark.parametrize(
    "text",
    [
        "takes 3.1 s",
        "takes 3\nms",
        "some 2.3 MB",
        "a share of 4 %",
        "is 8 times as long",
        "1.96×",
        "about 2 million operations",
        "18 a second",
        "1,000 instructions",
        "Measured on a spring: 21 mm",
    ],
)
def test_a_figure_without_a_word_is_refused(text: str, tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n\n{text}\n", encoding="utf-8")
    (_, passage) = passages_of(page)
    assert passage.figures, text


def test_comments_speak_of_the_passage_below(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- figures of: a.md -->\nIn 3 s.\n\n<!-- figures given: a limit -->\n\n"
        "| a |\n|---|\n| 4 s |\n\n5 s\n\n```sh\nsleep 6 s\n```\n\n"
        "<!-- figures -->\n\n7 s\n\n<!-- end -->\n\nfive, `8 s`, [a](9 s)\n",
        encoding="utf-8",
    )
    found = [(p.kind, p.about, p.figures) for p in passages_of(page)]
    assert found == [
        ("of", "a.md", ["3 s"]),
        ("given", "a limit", ["4 s"]),
        ("", "", ["5 s"]),
        ("", "", []),
    ]
