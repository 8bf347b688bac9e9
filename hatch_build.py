"""Writes the wheel with all packages below `msnn.`, so that it claims no other name.

The checkout keeps its folders and their imports. In the wheel `compiler/ir/` is
`msnn/compiler/ir/`, and `from compiler.ir import ops` is `from msnn.compiler.ir import ops`
(decision 0258).
"""

from __future__ import annotations

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

MOVED = ("spec_schema", "compiler", "backends", "templates")
STAYS = "msnn"

Edit = tuple[int, int, int, str]
"""Line from 1, first and last column in bytes, what stands there instead."""


class RelocatedPackages(BuildHookInterface[Any]):
    """Collects the files of a wheel; an editable install sees the checkout as it is."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Writes the moved files and names them to hatchling."""
        if version != "editable":
            folder = Path(self.directory) / "relocated"
            shutil.rmtree(folder, ignore_errors=True)
            relocate(Path(self.root), folder)
            build_data["force_include"][str(folder / STAYS)] = STAYS

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Takes away what only the wheel needed."""
        shutil.rmtree(Path(self.directory) / "relocated", ignore_errors=True)


def relocate(root: Path, folder: Path) -> None:
    """Writes all packages of the checkout below `folder / "msnn"`."""
    for package in (STAYS, *MOVED):
        for path in sorted((root / package).rglob("*")):
            if not path.is_file() or "__pycache__" in path.parts or path.name == "decisions.md":
                continue
            inside = path.relative_to(root)
            target = folder / (inside if package == STAYS else STAYS / inside)
            target.parent.mkdir(parents=True, exist_ok=True)
            if path.suffix == ".py":
                target.write_text(relocated(path.read_text("utf-8"), root), "utf-8", newline="\n")
            else:
                shutil.copyfile(path, target)


def relocated(source: str, root: Path) -> str:
    """The text with every import of a moved package, and every string that is a module of one,
    below `msnn.`; nothing else changes."""
    lines = source.encode().splitlines(keepends=True)
    for row, begin, end, text in sorted(_edits(ast.parse(source), lines, root), reverse=True):
        line = lines[row - 1]
        lines[row - 1] = line[:begin] + text.encode() + line[end:]
    return b"".join(lines).decode()


def _edits(tree: ast.Module, lines: list[bytes], root: Path) -> Iterator[Edit]:
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module), level=0) if _is_moved(module):
                at = lines[node.lineno - 1].index(b"from", node.col_offset) + len("from ")
                yield node.lineno, at, at, f"{STAYS}."
            case ast.Import(names=names) if any(_is_moved(alias.name) for alias in names):
                if len(names) > 1 or "." in names[0].name:
                    raise ValueError(f"line {node.lineno}: write `from … import …`")
                at = node.col_offset
                yield node.lineno, at, at + len("import"), f"from {STAYS} import"
            case ast.Constant(value=str(text)) if _is_module(text, root):
                at = lines[node.lineno - 1].index(text.encode(), node.col_offset)
                yield node.lineno, at, at, f"{STAYS}."
            case _:
                pass


def _is_moved(module: str) -> bool:
    return module.partition(".")[0] in MOVED


def _is_module(text: str, root: Path) -> bool:
    if "." not in text or not _is_moved(text) or not text.replace(".", "_").isidentifier():
        return False
    path = root.joinpath(*text.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()
