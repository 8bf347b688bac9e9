"""Orders alarms: those first that follow from no other one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msnn.verification.proof.eva import Alarm


def roots_first(alarms: Sequence[Alarm], folder: Path) -> list[Alarm]:
    """The roots in the order given, then the others.

    An alarm leaves its variable with any value. Whatever is computed of it, and of what is computed
    of that, is suspect; an alarm in a statement that reads nothing suspect is a root.
    """
    suspect: dict[str, dict[str, int]] = {}
    roots: set[Alarm] = set()
    # by lines, as code runs: a cause is met before what follows from it
    for alarm in sorted(alarms, key=lambda alarm: (alarm.file, alarm.line)):
        statements = _statements(folder / alarm.file)
        flow = suspect.setdefault(alarm.file, {})
        here = next((s for s in statements if s.first <= alarm.line <= s.last), None)
        if here is None or not _is_suspect(here, flow):
            roots.add(alarm)
        if here is not None and here.writes:
            flow.setdefault(here.writes, here.first)
            for later in (s for s in statements if s.first > here.first and s.writes):
                if _is_suspect(later, flow):
                    flow.setdefault(later.writes, later.first)
    return [*(a for a in alarms if a in roots), *(a for a in alarms if a not in roots)]


@dataclass(frozen=True, slots=True)
class _Statement:
    first: int
    last: int
    writes: str
    """The variable or field; empty where it is no assignment."""
    reads: frozenset[str]


def _is_suspect(statement: _Statement, flow: Mapping[str, int]) -> bool:
    """Whether it reads what has become suspect above it."""
    return any(flow.get(name, statement.first) < statement.first for name in statement.reads)


_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_CODE = re.compile(r"[^;{}]+[;{}]")
_NAME = re.compile(r"[A-Za-z_]\w*(?:->\w+)?")
_TARGET = re.compile(r"([A-Za-z_]\w*(?:->\w+)?)(?:\[[^=]*\])? [|+]?= ")


def _statements(path: Path) -> list[_Statement]:
    """None of a file that is not there."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    # blanks for comments, so that lines keep their numbers
    code = _COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), text)
    found: list[_Statement] = []
    for match in _CODE.finditer(code):
        begin = match.start() + len(match[0]) - len(match[0].lstrip())
        first, last = code.count("\n", 0, begin) + 1, code.count("\n", 0, match.end()) + 1
        target = _TARGET.search(match[0])
        rest = match[0] if target is None else match[0][target.end() :]
        writes = "" if target is None else target[1]
        found.append(_Statement(first, last, writes, frozenset(_NAME.findall(rest))))
    return found
