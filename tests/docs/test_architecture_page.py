"""The page of the architecture names rooms, files and classes that exist, and every room."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGES = ("spec_schema", "compiler", "backends", "msnn")
_ORDERS = dict(re.findall(r"^(\w+)/  (.+)$", PAGE, re.MULTILINE))


@pytest.mark.parametrize("package", PACKAGES)
def test_the_order_of_a_package_has_every_room_and_no_other(package: str) -> None:
    shown = set(_ORDERS[package].replace("{", " ").replace("}", " ").split())
    # folders of which a move left only compiled files are no rooms
    rooms = {path.parent.name for path in (ROOT / package).glob("*/*.py")}
    files = {path.stem for path in (ROOT / package).glob("*.py")}
    assert rooms <= shown, f"write {rooms - shown} into the order of {package} in architecture.md"
    assert shown <= rooms | files, f"{package} has no {shown - rooms - files}"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_order_is_the_one_that_is_checked(package: str) -> None:
    """The page goes from the lowest room up, `pyproject.toml` from the highest down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (layers,) = (c["layers"] for c in contracts if c.get("containers") == [package])
    ranks = {name: -k for k, layer in enumerate(layers) for name in re.findall(r"\w+", layer)}
    shown = re.findall(r"\w+", _ORDERS[package])
    assert shown == sorted(shown, key=ranks.__getitem__), "write them as in pyproject.toml"


def test_every_path_of_the_page_exists() -> None:
    tops = "|".join(PACKAGES)
    named = set(re.findall(rf"`((?:{tops})/[\w/.]*)`", PAGE))
    assert len(named) > 40
    known = {path for path in named if (ROOT / path).exists() or (ROOT / f"{path}.py").is_file()}
    missing = sorted(named - known)
    assert not missing, f"docs/architecture.md names what is not there: {missing}"


def test_every_class_that_the_page_says_is_given_exists() -> None:
    tables = PAGE.split("## Two commands, room by room")[1].split("## Where a new thing goes")[0]
    rows = [line.strip("|").split("|")[-1] for line in tables.splitlines() if line.startswith("|")]
    classes = {name for row in rows for name in re.findall(r"`([A-Z]\w+)`", row)}
    assert len(classes) >= 6
    code = "\n".join(
        path.read_text(encoding="utf-8")
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    )
    assert not {name for name in classes if not re.search(rf"^class {name}\b", code, re.MULTILINE)}
