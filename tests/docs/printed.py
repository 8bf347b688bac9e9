"""Compares what a page shows of a command with what the command has printed.

A line `…` stands for lines that are left out. Words are the same; numbers are equal but for 2 %,
as another C compiler rounds otherwise and a training ends a little elsewhere; what is below 1e-5 of
one is rounding itself, and only has to be as small again.
"""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?!\w)")
_LEFT_OUT = "…"


def compared(shown: str, said: str) -> tuple[str, str]:
    """What is wrong with the text that is shown, or nothing, and what it has to be."""
    lines = [line.rstrip() for line in said.splitlines()]
    wanted = shown.splitlines()
    now: list[str] = []
    wrong = ""
    at, may_skip = 0, False
    for line in wanted:
        if line.strip() == _LEFT_OUT:
            may_skip = True
            now.append(line)
            continue
        ahead = range(at, len(lines)) if may_skip else range(at, min(at + 1, len(lines)))
        place = next((n for n in ahead if _words(lines[n]) == _words(line)), None)
        if place is None:
            return f"is not printed: {line!r}; printed was\n{said}", _whole(wanted, said)
        if not _near(line, lines[place]):
            wrong = wrong or f"shows {line!r}, printed was {lines[place]!r}"
        now.append(lines[place])
        at, may_skip = place + 1, False
    if not may_skip and any(lines[at:]):
        return f"leaves out what is printed:\n{said}", _whole(wanted, said)
    return wrong, "\n".join([*now, ""])


def _whole(wanted: list[str], said: str) -> str:
    """All that was printed, unless the page leaves lines out: then somebody has to choose them."""
    chosen = any(line.strip() == _LEFT_OUT for line in wanted)
    return "\n".join([*wanted, ""]) if chosen else said


def _words(line: str) -> list[str]:
    """What is no number. Rules of tables and blanks between columns follow the numbers."""
    return _NUMBER.sub("#", line).split()


def _near(shown: str, said: str) -> bool:
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(said), strict=True)
    return all(_alike(float(one), float(other)) for one, other in pairs)


def _alike(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=0.02) or (abs(one) < 1e-5 and abs(other) < 1e-5)
