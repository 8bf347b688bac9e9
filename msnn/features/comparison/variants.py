"""Enumerates the models of a comparison: specs, each with every choice of the grid."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from msnn.features.comparison import errors
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.setting_values import one_form, one_path, shown_value, value_text
from spec_schema.yaml_tree.nodes import Listing
from spec_schema.yaml_tree.reader import read_tree

_GRID = "--grid"

Grid: TypeAlias = "Sequence[str] | Mapping[str, Sequence[object]]"
"""Texts in the form of `--grid`, or values by path."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A spec with overridden values, which is trained and compared."""

    spec: Path
    settings: tuple[str, ...]
    """Common settings, then those of the variant: `layers.h.fir.window=10`."""
    label: str
    """A label that distinguishes it from other variants."""
    drawn_by: int | None = None
    """The seed of the draws, if it was drawn."""


@dataclass(frozen=True, slots=True)
class GridAxis:
    """A key of the spec, and the values of it to try."""

    path: str
    values: tuple[str, ...]
    """Values in YAML syntax."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """Random values of several keys as YAML texts, one row per draw, one column per path."""

    paths: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    seed: int | None


def grid_axis(text: str) -> GridAxis:
    """Parses `layers.h.fir.window=5,10,20`, a path and values; values are YAML, lists and mappings
    in brackets.

    Raises SpecError for other texts.
    """
    path, equals, values = text.partition("=")
    # a line break would make two settings of one
    found = listed_values(values) if path.strip() and equals and "\n" not in path else None
    if found is None:
        raise SpecError((errors.malformed_grid(text),))
    return GridAxis(one_path(path), found)


def grid_axes(grid: Grid) -> list[GridAxis]:
    """The axes of a grid, from texts in the form of `--grid` or from a mapping of keys to values.
    Raises SpecError for malformed texts, and ValueError for values that JSON lacks, such as NaN.
    """
    if isinstance(grid, Mapping):
        return [
            GridAxis(one_path(path), tuple(map(value_text, values)))
            for path, values in grid.items()
        ]
    return [grid_axis(each) for each in grid]


def listed_values(text: str) -> tuple[str, ...] | None:
    """The YAML values between commas as they are written; None if the text is empty, invalid or has
    several lines.
    """
    findings = Findings()
    # as a flow list of YAML, so that commas within brackets and quotes do not separate
    listed = SourceText(_GRID, f"[{text}]")
    tree = None if "\n" in text else read_tree(listed, findings)
    if findings.failed or not isinstance(tree, Listing) or not tree.items:
        return None
    # the text of each value: read and written again, 1e-3 would be 0.001 in labels and log
    columns = ((item.span.column - 1, item.span.end_column - 1) for item in tree.items)
    return tuple(listed.text[begin:end] for begin, end in columns)


def variants(
    specs: Sequence[Path],
    grid: Sequence[GridAxis],
    settings: Sequence[str],
    drawn: Drawn | None = None,
) -> tuple[Variant, ...]:
    """Every spec with every draw and every combination of grid values, without duplicates.

    `settings` are common to all, written as `key=value`. The last axis varies fastest, draws
    slowest.
    """
    drawn = drawn or Drawn((), ((),), None)
    paths = [*drawn.paths, *(axis.path for axis in grid)]
    ends = _short(paths)
    found: list[Variant] = []
    for spec, name in zip(specs, _names(specs), strict=True):
        for row, choice in product(drawn.rows, product(*(axis.values for axis in grid))):
            values = (*row, *choice)
            own = [f"{path}={value}" for path, value in zip(paths, values, strict=True)]
            said = [f"{end}={shown_value(value)}" for end, value in zip(ends, values, strict=True)]
            label = " ".join([name, *said] if len(specs) > 1 or not said else said)
            found.append(Variant(spec, (*settings, *own), label, drawn.seed))
    once: dict[tuple[object, ...], Variant] = {}
    for each in found:  # 0.1 and 1e-1 are one training, in one folder
        once.setdefault((each.spec, *map(one_form, each.settings)), each)
    return tuple(once.values())


def _names(specs: Sequence[Path]) -> list[str]:
    stems = [spec.name.split(".")[0] for spec in specs]
    # two files of one name in two folders
    alike = len(set(stems)) < len(set(specs))
    return [str(spec) for spec in specs] if alike else stems


def _short(paths: Sequence[str]) -> list[str]:
    """The shortest suffixes by which the paths differ: `window`, or `f.window` and `g.window`.
    Suffixes that begin with a number are avoided.
    """
    steps = [path.split(".") for path in paths]
    for depth in range(1, max(map(len, steps), default=1)):
        ends = [".".join(each[-depth:]) for each in steps]
        # `0.epochs` says nothing without `train` before it
        if len(set(ends)) == len(ends) and not any(end[0].isdecimal() for end in ends):
            return ends
    return list(paths)


Law: TypeAlias = Literal["uniform", "log", "integer"]
_CALL = re.compile(r"\s*(uniform|log|integer|choice)\s*\((.*)\)\s*([^()]*)", re.DOTALL)
_LAWS: Mapping[str, Law] = {"uniform": "uniform", "log": "log", "integer": "integer"}
_DIGITS = 6
"""Significant digits of a drawn number, so that labels show the exact value."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """A random distribution between `low` and `high`: uniform, log-uniform (`log`), or integer with
    both bounds included. `unit` is appended to each value.
    """

    law: Law
    low: float
    high: float
    unit: str = ""

    def value(self, share: float) -> str:
        """The quantile of the distribution at `share`, from 0 to below 1, as YAML text with the
        unit.
        """
        match self.law:
            case "uniform":
                number = self.low + share * (self.high - self.low)
            case "log":
                # low^(1−s) high^s
                number = self.low * (self.high / self.low) ** share
            case "integer":
                # both bounds are drawn, as often as the numbers between
                number = math.floor(self.low + share * (self.high - self.low + 1))
        return self.text(number)

    def text(self, number: float) -> str:
        """A number between the bounds as YAML text with the unit, rounded to 6 significant digits
        unless it is an integer.
        """
        shown = float(f"{number:.{_DIGITS}g}")
        text = f"{int(number)}" if self.law == "integer" else repr(_within(shown, self))
        return f"{text} {self.unit}".rstrip()

    def __str__(self) -> str:
        return f"{self.law}({self.low:g}, {self.high:g}) {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Listed:
    """A random choice between values with equal probability; texts are in YAML syntax."""

    values: tuple[str, ...]

    def value(self, share: float) -> str:
        return self.values[math.floor(share * len(self.values))]

    def __str__(self) -> str:
        return f"choice({', '.join(self.values)})"


@dataclass(frozen=True, slots=True)
class DrawAxis:
    """A key of the spec whose values are drawn at random, and their distribution."""

    path: str
    law: Bounds | Listed


@dataclass(frozen=True, slots=True)
class Draws:
    """The keys whose values are drawn at random, the number of draws, and the seed."""

    axes: tuple[DrawAxis, ...] = ()
    count: int = 0
    seed: int = 0

    @property
    def drawn(self) -> Drawn | None:
        """One value per axis, `count` times; None if nothing is drawn.

        Draw i of a key depends only on the seed, i and the key. More draws, or another key, do not
        change the others.
        """
        if not self.axes:
            return None
        rows = [
            tuple(axis.law.value(_share(self.seed, draw, axis.path)) for axis in self.axes)
            for draw in range(self.count)
        ]
        return Drawn(tuple(axis.path for axis in self.axes), rows, self.seed)

    @property
    def each_choice(self) -> Drawn:
        """Few rows for an early check of a spec: each value of a choice occurs in one of them, and
        numbers have their lower bound.
        """
        choices = [
            axis.law.values if isinstance(axis.law, Listed) else (axis.law.text(axis.law.low),)
            for axis in self.axes
        ]
        rows = [
            tuple(values[min(row, len(values) - 1)] for values in choices)
            # a shorter list repeats its last choice
            for row in range(max(map(len, choices), default=1))
        ]
        return Drawn(tuple(axis.path for axis in self.axes), rows, self.seed)

    @property
    def numbers(self) -> frozenset[str]:
        """The keys that are drawn between bounds rather than from a list."""
        return frozenset(axis.path for axis in self.axes if isinstance(axis.law, Bounds))


NO_DRAWS = Draws()


def draw_axes(given: Sequence[str] | Mapping[str, str]) -> tuple[DrawAxis, ...]:
    """Parses texts such as `parameters.k.init=log(1, 100) N/m`, or a mapping from key to
    distribution.

    Raises SpecError for other texts, and for bounds between which nothing can be drawn.
    """
    if isinstance(given, Mapping):
        return tuple(_axis(path, law, f"{path}={law}") for path, law in given.items())
    # the first `=`: laws have none, texts of a choice may
    split = ((text, *text.partition("=")) for text in given)
    return tuple(_axis(path, law, text) for text, path, _, law in split)


def _axis(path: str, law: str, text: str) -> DrawAxis:
    call = _CALL.fullmatch(law)
    values = None if call is None else listed_values(call[2])
    if call is None or not path.strip() or values is None:
        raise SpecError((errors.malformed_draw(text),))
    name, unit = call[1], call[3].strip()
    if name == "choice":
        if unit:
            raise SpecError((errors.malformed_draw(text),))
        return DrawAxis(one_path(path), Listed(values))
    try:
        low, high = map(float, values)
    except ValueError:
        raise SpecError((errors.malformed_draw(text),)) from None
    found = Bounds(_LAWS[name], low, high, unit)
    _require_bounds(found, text)
    return DrawAxis(one_path(path), found)


def _require_bounds(found: Bounds, text: str) -> None:
    low, high = found.low, found.high
    why = None
    if not (math.isfinite(low) and math.isfinite(high)):
        why = "a bound is not finite"
    elif low >= high:
        why = f"{low:g} is not below {high:g}"
    elif found.law == "log" and low <= 0:
        why = f"{low:g} has no logarithm"
    # what `value` computes with: finite bounds can be infinitely far apart
    elif not math.isfinite(high / low if found.law == "log" else high - low + 1):
        why = "the bounds are too far apart"
    elif found.law == "integer" and not (low.is_integer() and high.is_integer()):
        why = "a bound is no whole number"
    if why is not None:
        raise SpecError((errors.wrong_bounds(text, why),))


def _share(seed: int, draw: int, path: str) -> float:
    # not `hash`, which differs from process to process
    # numpy mixes the words of a seed (SeedSequence), so that neighbouring draws are independent
    key = (seed, draw, zlib.crc32(path.encode()))
    return float(np.random.default_rng(key).random())


def _within(number: float, bounds: Bounds) -> float:
    """The number clipped to the bounds, which rounding might exceed."""
    return min(max(number, bounds.low), bounds.high)
