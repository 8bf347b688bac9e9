"""The site of the documentation: built strictly, whole, without a network, and usable by all."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command_line import ROOT, in_new_process
from tests.conditions import require_package
from tests.docs.usable import MODES, faults_of
from tests.features.report_page.browser import opened


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make site` does; strict, so a dead link or anchor fails it."""
    require_package("mkdocs", "make setup")
    folder = tmp_path_factory.mktemp("site") / "msnn"
    found = subprocess.run(
        [sys.executable, ROOT / ".ci" / "site.py", folder],
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    return folder


def test_nothing_is_fetched_from_elsewhere(site: Path):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r'<(?:script|img|iframe|source)[^>]*\ssrc="(?:https?:)?//', text)
        fetched += re.findall(r'<link[^>]*rel="(?:stylesheet|preconnect|icon)"[^>]*//', text)
        assert fetched == [], page.name
        assert "fonts.g" not in text, page.name


def test_search_finds_guides_before_explanations_of_messages(site: Path):
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    boosts = {entry["location"]: entry.get("boost", 1) for entry in index["docs"]}
    pages = [p for p in boosts if p.startswith("how-to/") and not p.endswith("/index.html")]
    guides = [boosts[page] for page in ("tutorial.html", *pages)]
    later = [b for p, b in boosts.items() if "explanations/" in p or "decisions.html" in p]
    assert len(guides) > 5
    assert len(later) > 500
    assert min(guides) > 1 > max(later)


def test_the_commands_of_the_front_page(tmp_path: Path):
    folder = tmp_path / "models"
    shutil.copytree(ROOT / "examples" / "ci", folder)
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    (commands,) = re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    for line in commands.splitlines():
        command, *words = line.partition("#")[0].split()
        assert command == "msnn"
        said = in_new_process(words, folder / "specs")
        assert said.code == 0, said.err


@pytest.mark.parametrize("page", ["index.html", "names.html", "tutorial.html"])
@pytest.mark.parametrize(("width", "dark"), MODES)
def test_everybody_can_use_it(site: Path, page: str, width: int, dark: bool):
    """axe-core finds nothing, nothing is wider than the screen, nothing was fetched in vain.

    `benchmarks/site/look.py` opens all pages.
    """
    require_package("axe_selenium_python", "make setup")
    with opened(site / page, width=width, dark=dark) as browser:
        assert faults_of(browser, width) == []


def test_spec_picture_c_and_figures_are_one_screen_of_a_desk(site: Path):
    with opened(site / "index.html") as browser:
        ends = browser.execute_script(
            """return [".front pre code", ".front-claim img", ".front-figures table"].map(
                (part) => document.querySelector(part).getBoundingClientRect().bottom)"""
        )
        assert max(ends) <= 900
