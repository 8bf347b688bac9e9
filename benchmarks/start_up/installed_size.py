"""Measures the disk space of msnn and its dependencies in an environment, without other packages.

python benchmarks/start_up/installed_size.py # of this environment, with [all] python
benchmarks/start_up/installed_size.py SITE_PACKAGES light # of another, without extras python
benchmarks/start_up/installed_size.py --write # of this one; writes INSTALLED.md

Files are counted by the blocks that they take, with their bytecode, as `du` does.
"""

from __future__ import annotations

import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from importlib.util import cache_from_source
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
_SHOWN = 12
_BLOCK = 512
"""Bytes of a block, by POSIX."""
_GPU = ("torch", "nvidia-", "cuda-", "triton")
"""How the names begin of what torch for Linux brings."""
_TEXT = """\
# What msnn takes on the disk

Written by `python benchmarks/start_up/installed_size.py --write`, with all extras:
{count} packages, {total:.1f} GB, of which torch and its GPU libraries {torch:.1f} GB. The largest:

| package | MB |
|---|---|
{rows}
"""


def main() -> None:
    words = [word for word in sys.argv[1:] if word not in ("light", "--write")]
    site = words[0] if words else sysconfig.get_path("purelib")
    installed = {_name(found.name): found for found in distributions(path=[site])}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted: list[str] = [*project["dependencies"]]
    if "light" not in sys.argv:
        extras = project["optional-dependencies"]
        wanted += [text for name, texts in extras.items() if name != "all" for text in texts]
    names = set(_needed(wanted, installed))
    if "msnn" in installed:
        names.add("msnn")
    sizes = {name: _size(installed[name]) for name in names}
    print(f"{len(sizes)} packages, {sum(sizes.values()) / 1e6:,.0f} MB")
    for name, size in sorted(sizes.items(), key=lambda item: -item[1])[:_SHOWN]:
        print(f"{size / 1e6:10,.1f}  {name}")
    if "--write" in sys.argv:
        page = Path(__file__).with_name("INSTALLED.md")
        page.write_text(_page(sizes), encoding="utf-8")


def _page(sizes: dict[str, int]) -> str:
    largest = sorted(sizes.items(), key=lambda item: -item[1])[:_SHOWN]
    return _TEXT.format(
        count=len(sizes),
        total=1e-9 * sum(sizes.values()),
        torch=1e-9 * sum(size for name, size in sizes.items() if name.startswith(_GPU)),
        rows="\n".join(f"| {name} | {1e-6 * size:,.0f} |" for name, size in largest),
    )


def _needed(wanted: list[str], installed: dict[str, Distribution]) -> Iterator[str]:
    """Yields the names of all direct and indirect dependencies."""
    todo, seen = [Requirement(text) for text in wanted], set[str]()
    while todo:
        asked = todo.pop()
        name = _name(asked.name)
        if f"{asked.name}{sorted(asked.extras)}" in seen:
            continue
        seen.add(f"{asked.name}{sorted(asked.extras)}")
        if name not in installed:
            print(f"{name} is not installed, and not counted", file=sys.stderr)
            continue
        yield name
        for text in installed[name].requires or ():
            one = Requirement(text)
            extras = ("", *asked.extras)
            if one.marker is None or any(one.marker.evaluate({"extra": e}) for e in extras):
                todo.append(one)


def _name(text: str) -> str:
    return canonicalize_name(text)


def _size(found: Distribution) -> int:
    files = {Path(str(found.locate_file(file))) for file in found.files or ()}
    files |= {Path(cache_from_source(str(file))) for file in files if file.suffix == ".py"}
    return sum(file.lstat().st_blocks * _BLOCK for file in files if file.is_file())


if __name__ == "__main__":
    main()
