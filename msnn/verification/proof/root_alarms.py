"""Sorts alarms: first those that are not consequences of another one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msnn.verification.proof.eva import Alarm


def roots_first(alarms: Sequence[Alarm], folder: Path) -> list[Alarm]:
    """The root alarms in their order, then the others.

    After an alarm, its variable may have any value, so everything computed from it is suspect. An
    alarm in a statement without suspect operands is a root.
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
    """The assigned variable or field; empty for other statements."""
    reads: frozenset[str]


def _is_suspect(statement: _Statement, flow: Mapping[str, int]) -> bool:
    """True if it reads a variable that became suspect before it."""
    return any(flow.get(name, statement.first) < statement.first for name in statement.reads)


_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_CODE = re.compile(r"[^;{}]+[;{}]")
_NAME = re.compile(r"[A-Za-z_]\w*(?:->\w+)?")
_TARGET = re.compile(r"([A-Za-z_]\w*(?:->\w+)?)(?:\[[^=]*\])? [|+]?= ")


def _statements(path: Path) -> list[_Statement]:
    """The statements of a C file; empty if it does not exist."""
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
