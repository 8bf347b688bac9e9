"""Finds the files whose functions make diagnostics: those of the core and of each feature."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]


def message_files() -> list[Path]:
    """The files below the folders `errors`, and files `errors.py` of features."""
    folders = [ROOT / "spec_schema/errors", ROOT / "msnn/errors"]
    folders += (ROOT / "msnn/features").glob("*/errors")
    files = [path for folder in folders for path in folder.rglob("*.py")]
    return sorted([*files, *(ROOT / "msnn/features").glob("*/errors.py")])
