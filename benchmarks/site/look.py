"""Opens every page of the site in Chromium: is there a finding of axe-core, a page too wide?

    python benchmarks/site/look.py [--write] [--navigation] [--only WORD] [--pictures FOLDER]

It builds the site first. Pages somebody opens from the navigation are opened on a desk and on a
phone, light and dark; decisions and explanations of messages, of which there are hundreds laid out
alike, on a phone, light, and on a desk, dark. `--write` writes RESULTS.md, `--navigation` leaves
out what is laid out alike, `--only` takes pages with a word in their path, `--pictures` keeps what
each looks like. Takes a quarter of an hour.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.docs.usable import MODES, faults_of
from tests.features.report_page.browser import chromium

ROOT = Path(__file__).resolve().parents[2]
_ALIKE = ("decisions.", "spec_schema/explanations/")
_MODES_OF_ALIKE = [(390, False), (1280, True)]


@dataclass(frozen=True)
class Looks:
    """The number of pages that were opened in one mode, and the findings."""

    width: int
    dark: bool
    pages: int
    alike: int
    faults: list[str]

    @property
    def row(self) -> str:
        mode = f"{self.width} pixels, {'dark' if self.dark else 'light'}"
        return f"| {mode} | {self.pages} | {self.alike} | {len(self.faults)} |"


def main() -> int:
    """Prints every finding and a table; 1 where there is a finding."""
    given = _arguments()
    with tempfile.TemporaryDirectory() as folder:
        site = Path(folder) / "msnn"
        began = time.perf_counter()
        subprocess.run([sys.executable, ROOT / ".ci" / "site.py", site], check=True)
        built = time.perf_counter() - began
        pages = [page for page in _pages(site) if given.only in str(page)]
        if given.navigation:
            pages = [page for page in pages if not _is_alike(page)]
        looks = [_look(site, pages, *mode, pictures=given.pictures) for mode in MODES]
    found = [f"- {fault}" for look in looks for fault in look.faults]
    text = _TEXT.format(
        called=" --navigation" if given.navigation else "",
        built=built,
        table="\n".join(look.row for look in looks),
        found="\n".join(found or ["Nothing was found."]),
    )
    print(text)
    if given.write:
        Path(__file__).with_name("RESULTS.md").write_text(text, encoding="utf-8")
    return 1 if any(look.faults for look in looks) else 0


_TEXT = """\
# The site, page by page

Written by `python benchmarks/site/look.py --write{called}`. Building, strictly, so that a dead
link or anchor would have ended it, took {built:.0f} s by the clock.
A finding is a violation that axe-core reports, a page wider than its screen, or a complaint in the
browser's console. Decisions and explanations of messages are laid out alike and opened in two of
the four modes.

| screen | pages | decisions, explanations | findings |
|---|---|---|---|
{table}

{found}
"""


def _pages(site: Path) -> list[Path]:
    """All pages except the one for unknown addresses, which only a server shows."""
    return [page for page in sorted(site.rglob("*.html")) if page.name != "404.html"]


def _is_alike(page: Path) -> bool:
    return any(part in str(page) for part in _ALIKE)


def _look(site: Path, pages: list[Path], width: int, dark: bool, pictures: Path | None) -> Looks:
    alike = [page for page in pages if _is_alike(page)]
    others = [page for page in pages if page not in alike]
    if (width, dark) not in _MODES_OF_ALIKE:
        alike = []
    faults: list[str] = []
    with chromium(width=width, dark=dark) as browser:
        for page in (*others, *alike):
            browser.get(page.as_uri())
            name = str(page.relative_to(site).with_suffix(""))
            found = [f"{name} at {width}, dark: {dark}: {f}" for f in faults_of(browser, width)]
            print(*found, sep="\n", end="\n" * bool(found), flush=True)
            faults += found
            if pictures is not None:
                shade = "dark" if dark else "light"
                _keep(browser, pictures / f"{name.replace('/', '_')}_{width}_{shade}.png")
    return Looks(width=width, dark=dark, pages=len(others), alike=len(alike), faults=faults)


def _keep(browser: Any, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    browser.execute_script("window.scrollTo(0, 0)")
    browser.save_screenshot(str(file))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Opens every page of the site.")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--navigation", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--pictures", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
