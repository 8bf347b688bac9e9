"""Appends to the job summary of a code host: the file in GITHUB_STEP_SUMMARY."""

from __future__ import annotations

from pathlib import Path


def append_summary(file: Path, text: str) -> None:
    """Appends Markdown to the file, separated from the output of other steps."""
    file.parent.mkdir(parents=True, exist_ok=True)
    # appended, not replaced: GitHub gives every step of a job the same file
    with file.open("a", encoding="utf-8") as page:
        page.write(f"{text}\n")
