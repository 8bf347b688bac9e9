"""Decisions have one number each, and links and comments name decisions that exist."""

from __future__ import annotations

import os
import re
import subprocess
from collections import Counter
from pathlib import Path

from tests.docs.decisions import PAGES, ROOT, recorded

_LINK = re.compile(r"\]\(([^)\s#]*decisions\.md)#([^)\s]+)\)")
_MERGED = re.compile(r"^Includes ([\d, and]+)\.$", re.MULTILINE)
_NAMED = re.compile(r"\bdecisions?\s+#?\s*(\d{4})((?:,\s*\d{4})*(?:\s+and\s+\d{4})?)")


def _texts(*patterns: str) -> list[tuple[Path, str]]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", *patterns], cwd=ROOT, capture_output=True, text=True, check=True
    )
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    return [(path, path.read_text("utf-8")) for path in paths if path.is_file()]


def test_every_number_is_used_once():
    counts = Counter(decision.number for decision in recorded())
    assert len(counts) > 100
    assert [number for number, count in counts.items() if count > 1] == []


def test_merged_numbers_are_not_used_again():
    merged = [
        number
        for page in PAGES
        for line in _MERGED.findall(page.read_text("utf-8"))
        for number in re.findall(r"\d{4}", line)
    ]
    counts = Counter([*merged, *(decision.number for decision in recorded())])
    assert merged
    assert [number for number in merged if counts[number] > 1] == []


def test_links_to_decisions_lead_to_their_headings():
    anchors = {(decision.page, decision.anchor) for decision in recorded()}
    broken = [
        f"{path.relative_to(ROOT)}: {target}#{anchor}"
        for path, text in _texts("*.md")
        for target, anchor in _LINK.findall(text)
        if (Path(os.path.normpath(path.parent / target)), anchor) not in anchors
    ]
    assert broken == []


def test_decisions_that_code_and_pages_name_exist():
    numbers = {decision.number for decision in recorded()}
    unknown = [
        f"{path.relative_to(ROOT)}: {number}"
        for path, text in _texts("*.md", "*.py", "*.c", "*.h", "*.j2")
        for found in _NAMED.finditer(text)
        for number in re.findall(r"\d{4}", found[0])
        if number not in numbers and path.name != "CHANGELOG.md"
    ]
    assert unknown == []
