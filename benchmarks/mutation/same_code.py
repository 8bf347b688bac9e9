"""Proves that a change changes no answer: a compiler makes the same code of both sources.

Papadakis, Jia, Harman, Le Traon: Trivial compiler equivalence, 2015. The compiler may assume that
numbers are finite and that nothing asks for the sign of a zero, so that `x * 0` is 0 and `x + 0` is
x. What asks whether a number is finite is hidden from it: such questions stay as they are. Under
what it assumes nothing is proved of infinities and NaN: `random_calls.py` tries these.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

_FLAGS = (
    *("-std=c99", "-O2", "-w", "-S", "-o", "-", "-ffp-contract=off", "-fno-math-errno"),
    *("-fno-trapping-math", "-ffinite-math-only", "-fno-signed-zeros"),
)
_FINITE = re.compile(r"fabsf\(([^;{}?]*?)\) <= 3\.4028235e\+38f")
_HIDDEN = "extern _Bool is_finite(float) __attribute__((const));\n"


def code_of(source: str, includes: Sequence[Path], folder: Path) -> str:
    """The machine code that gcc makes of a source in single precision."""
    path = folder / "compared.c"
    path.write_text(_HIDDEN + _FINITE.sub(r"is_finite(\1)", source), encoding="utf-8")
    command = ["gcc", *_FLAGS, *(f"-I{path}" for path in includes), path]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
