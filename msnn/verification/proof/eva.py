"""Runs Frama-C's Eva on one function of an export, and parses values and alarms."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msnn.verification.exported_c import ExportedC
from msnn.verification.proof_step import FRAMA_C, run_tool

PRECISION = "7"
_ALARM = re.compile(r"\[eva:alarm\] (\S+?):(\d+): Warning:\s*([^\n]*)\n?([^\[]*)")
_NUMBER = r"[-+.\w]+"
_SHOWN = re.compile(
    rf"Frama_C_show_each_(\w+):\s*(?:\[({_NUMBER}) \.\. ({_NUMBER})\]|\{{({_NUMBER})\}}|(NaN))"
    r"(\s*∪\s*\{NaN\})?"
)


@dataclass(frozen=True, slots=True)
class Alarm:
    """A place where Eva cannot exclude a run-time error."""

    file: str
    line: int
    claim: str


@dataclass(frozen=True, slots=True)
class PossibleValues:
    """The interval of a quantity, with limits that may be infinite, and whether it may be NaN."""

    low: float
    high: float
    nan: bool

    @property
    def finite(self) -> bool:
        """True if every value is finite."""
        return not self.nan and math.isfinite(self.low) and math.isfinite(self.high)

    def joined(self, other: PossibleValues) -> PossibleValues:
        low, high = min(self.low, other.low), max(self.high, other.high)
        return PossibleValues(low, high, self.nan or other.nan)


@dataclass(frozen=True, slots=True)
class Analysis:
    """The results of Eva; `values` by the names that `main` uses."""

    alarms: tuple[Alarm, ...]
    values: dict[str, PossibleValues]


def analysed(model: ExportedC, main: Path, *, infinite: bool, folder: Path) -> Analysis:
    """Analyses a `main` with the sources of a model.

    A float that becomes NaN is an alarm. One that becomes infinite is an alarm too, unless `main`
    draws `infinite` values; then `values` shows where they remain.
    """
    # of kernels Eva gets bounds instead of bodies
    sources = [path for path in model.model_sources if not path.stem.endswith("_math")]
    if not infinite:
        sources = [_among_numbers(path, folder) for path in sources]
    said = run_tool(
        [
            *(FRAMA_C.command, "-eva", "-eva-precision", PRECISION),
            # Eva's switch holds for all floats: it cannot allow infinite inputs and refuse infinite
            # results
            *("-warn-special-float", "nan" if infinite else "non-finite"),
            # int, pointers and size_t of 32 bits, as on the boards
            *("-machdep", "gcc_x86_32"),
            f"-cpp-extra-args=-I{model.include} -I{model.folder / 'src'}",
            *(main, *sources),
        ],
        folder,
    )
    return Analysis(tuple(dict.fromkeys(_alarms(said))), _values(said))


def _among_numbers(source: Path, folder: Path) -> Path:
    """The source with INFINITY in comparisons replaced by the largest finite number.

    This is equivalent if every float is finite or an alarm. INFINITY itself would be an alarm after
    which Eva follows no call.
    """
    text = source.read_text(encoding="utf-8")
    changed = text
    for limit, largest in _LARGEST.items():
        changed = changed.replace(f"<= {limit})", f"<= {largest})")
    if changed == text:
        return source
    copy = folder / source.name
    copy.write_text(changed, encoding="utf-8")
    return copy


_LARGEST = {"INFINITY": "3.40282347e+38f", "((double)INFINITY)": "1.7976931348623157e+308"}
"""The largest number of each type, by the C expression for infinity."""


def _alarms(said: str) -> Iterator[Alarm]:
    for match in _ALARM.finditer(said):
        path, line, what, rest = match.groups()
        # a claim goes over several lines, indented
        claim = " ".join((what + " " + rest).split())
        yield Alarm(Path(path).name, int(line), claim[:160])


def _values(said: str) -> dict[str, PossibleValues]:
    """The interval of all values shown under each name."""
    found: dict[str, PossibleValues] = {}
    for name, low, high, one, only_nan, or_nan in _SHOWN.findall(said):
        # no number at all: the neutral element of joining intervals
        bounds = (math.inf, -math.inf) if only_nan else (float(one or low), float(one or high))
        shown = PossibleValues(*bounds, nan=bool(only_nan or or_nan))
        found[name] = shown.joined(found.get(name, shown))
    return found


def roots_first(alarms: Sequence[Alarm], folder: Path) -> list[Alarm]:
    """Sorts alarms: those with a cause of their own first, then those that may follow from others.

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
