"""The walls of the house: folders of about a dozen things, files of at most 300 lines."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("spec_schema", "compiler", "backends", "msnn")

MOST_THINGS = 15
MOST_LINES = 300

# one file for each of what is listed, and nothing else: whoever looks for one knows its name
CATALOGUES = {"msnn/cli/verbs", "spec_schema/errors"}
# their things are rooms, in the order that pyproject.toml has
OF_ROOMS = {*PACKAGES}


def _folders() -> list[Path]:
    found = [path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    return sorted({*found})


@pytest.mark.parametrize("folder", _folders(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_room_has_at_most_a_dozen_things_or_so(folder: Path) -> None:
    name = folder.relative_to(ROOT).as_posix()
    things = [
        path.name
        for path in folder.iterdir()
        if (path.suffix == ".py" and path.name != "__init__.py")
        or (path.is_dir() and any(path.rglob("*.py")))
    ]
    if name not in CATALOGUES | OF_ROOMS:
        assert len(things) <= MOST_THINGS, (
            f"{name} has {len(things)} things: make a room in it for those that share an idea"
        )


def test_no_file_is_longer_than_300_lines() -> None:
    lengths = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8").count("\n")
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    long = {name: n for name, n in lengths.items() if n > MOST_LINES}
    assert not long, f"split by idea: {long}"
