"""Builds exported sources as C99 and as C++ with warnings that are errors."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.conditions import require_tool

_STRICT = ("-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wdouble-promotion", "-O2")


def build_strictly(folder: Path) -> None:
    """CalledProcessError where a compiler has anything to say."""
    require_tool("g++", install="apt install g++")
    sources = sorted((folder / "src").glob("*.c"))
    assert sources
    include = f"-I{folder / 'include'}"
    for source in sources:
        compiled = ["-c", source, "-o", "/dev/null"]
        subprocess.run(["gcc", "-std=c99", "-pedantic", *_STRICT, include, *compiled], check=True)
    # what the optimiser finds it has found in C: C++ adds rules of its language
    subprocess.run(["g++", "-x", "c++", *_STRICT, include, "-fsyntax-only", *sources], check=True)
