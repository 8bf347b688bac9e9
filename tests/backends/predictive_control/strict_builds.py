"""Builds exported sources as C99 and as C++ with warnings that are errors."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.conditions import require_tool

_STRICT = ("-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wdouble-promotion", "-O2")


def build_strictly(folder: Path) -> None:
    """CalledProcessError where a compiler has anything to say."""
    require_tool("g++", install="apt install g++")
    for source in sorted((folder / "src").glob("*.c")):
        include = [f"-I{folder / 'include'}", "-c", source, "-o", "/dev/null"]
        subprocess.run(["gcc", "-std=c99", "-pedantic", *_STRICT, *include], check=True)
        subprocess.run(["g++", "-x", "c++", *_STRICT, *include], check=True)
