"""Builds the site of the documentation: its pages and all that they link to, each link checked.

`python .ci/site.py [FOLDER]`; by default it goes to build/site.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_LINK = re.compile(r"\]\(([^)#:\s]+)(#[^)\s]*)?\)")
_BOOSTS = (
    ("*/decisions.md", 0.3),
    ("spec_schema/explanations/*", 0.3),
    ("CHANGELOG.md", 0.3),
    ("docs/tutorial.md", 4),
    ("docs/how-to/*", 4),
    ("docs/identification.md", 3),
    ("docs/ci.md", 3),
    ("docs/nnodely.md", 2),
    ("docs/mpc.md", 2),
    ("docs/data.md", 2),
)
"""Who searches wants a guide first: by how much pages count more or less than others."""


def main(site: Path) -> int:
    pages = site.with_name(f"{site.name}_pages")
    gather(pages)
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--clean", "--site-dir", site]
    environment = {**os.environ, "SITE_PAGES": str(pages)}
    return subprocess.run(build, cwd=ROOT, env=environment, check=False).returncode


def gather(pages: Path) -> None:
    """Copies every page of `docs/`, and what pages link to, with links that lead to the copies."""
    shutil.rmtree(pages, ignore_errors=True)
    ahead = [ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]
    ahead += [*ROOT.glob("examples/*/README.md"), *(ROOT / "docs" / "site").iterdir()]
    done: set[Path] = set()
    while ahead:
        file = ahead.pop()
        if file in done:
            continue
        done.add(file)
        place = pages / _place(file)
        place.parent.mkdir(parents=True, exist_ok=True)
        if file.is_dir():
            linked = [path for path in sorted(file.iterdir()) if path.suffix == ".md"]
            place.write_text(_listing(file, linked), encoding="utf-8")
        elif file.suffix == ".md":
            text = file.read_text(encoding="utf-8")
            linked = [p for m in _LINK.finditer(text) if (p := _meant(file, m[1])) is not None]
            place.write_text(_searched(file) + _rewritten(file, text), encoding="utf-8")
        else:
            linked = []
            shutil.copyfile(file, place)
        ahead += linked


def _searched(file: Path) -> str:
    """The head of a page that search is to find earlier or later than others."""
    path = file.relative_to(ROOT)
    boost = next((by for pattern, by in _BOOSTS if path.match(pattern)), None)
    return "" if boost is None else f"---\nsearch: {{boost: {boost}}}\n---\n"


def _rewritten(file: Path, text: str) -> str:
    def written(found: re.Match[str]) -> str:
        meant = _meant(file, found[1])
        if meant is None:
            return found[0]
        seen = os.path.relpath(_place(meant), _place(file).parent)
        return f"]({Path(seen).as_posix()}{found[2] or ''})"

    return _LINK.sub(written, text)


def _meant(file: Path, target: str) -> Path | None:
    """The file of the repository that a link leads to; of a folder its README, if it has one."""
    path = Path(os.path.normpath(file.parent / target))
    if not path.exists() or not path.is_relative_to(ROOT):
        return None
    readme = path / "README.md"
    return readme if readme.is_file() else path


def _place(file: Path) -> Path:
    """Where a file stands on the site: pages of `docs/` at its top."""
    docs = ROOT / "docs"
    inside = file.is_relative_to(docs)
    place = file.relative_to(docs) if inside else Path("repository") / file.relative_to(ROOT)
    return place / "index.md" if file.is_dir() else place


def _listing(folder: Path, pages: list[Path]) -> str:
    """A page for a folder that has none: its pages by their titles, or what files it has."""
    title = folder.name.replace("_", " ").capitalize()
    lines = [f"- [{_title(page)}]({page.name})" for page in pages]
    lines = lines or [f"- `{path.name}`" for path in sorted(folder.iterdir())]
    return "\n".join([f"# {title}", "", *lines, ""])


def _title(page: Path) -> str:
    first = page.read_text(encoding="utf-8").partition("\n")[0]
    return first.lstrip("# ").replace("[", "").replace("]", "")


if __name__ == "__main__":
    sys.exit(main(Path(*sys.argv[1:2] or [ROOT / "build" / "site"]).absolute()))
