"""Appends to the page that a code host shows of a job: the file named by GITHUB_STEP_SUMMARY."""

from __future__ import annotations

from pathlib import Path


def append_summary(file: Path, text: str) -> None:
    """Adds Markdown to the file, apart from what other steps have written there."""
    file.parent.mkdir(parents=True, exist_ok=True)
    # appended, not replaced: GitHub gives every step of a job the same file
    with file.open("a", encoding="utf-8") as page:
        page.write(f"{text}\n")
