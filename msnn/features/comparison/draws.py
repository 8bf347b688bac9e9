"""Draws values of a spec at random: uniform, log-uniform, integer, or from a list."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from msnn.features.comparison.errors import sweeps as errors
from msnn.features.comparison.variants import Drawn, listed_values
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.setting_values import one_path

Law: TypeAlias = Literal["uniform", "log", "integer"]
_CALL = re.compile(r"\s*(uniform|log|integer|choice)\s*\((.*)\)\s*([^()]*)", re.DOTALL)
_LAWS: Mapping[str, Law] = {"uniform": "uniform", "log": "log", "integer": "integer"}
_DIGITS = 6
"""Significant digits of a drawn number, so that labels show the exact value."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Numbers from `low` to `high`: uniform, log-uniform (`log`), or integer."""

    law: Law
    low: float
    high: float
    unit: str = ""

    def value(self, share: float) -> str:
        """The quantile of the distribution at `share`, as YAML text."""
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
        """A number between the bounds as YAML text, rounded for labels."""
        shown = float(f"{number:.{_DIGITS}g}")
        text = f"{int(number)}" if self.law == "integer" else repr(_within(shown, self))
        return f"{text} {self.unit}".rstrip()

    def __str__(self) -> str:
        return f"{self.law}({self.low:g}, {self.high:g}) {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Listed:
    """One of these values with equal probability; texts in YAML syntax."""

    values: tuple[str, ...]

    def value(self, share: float) -> str:
        return self.values[math.floor(share * len(self.values))]

    def __str__(self) -> str:
        return f"choice({', '.join(self.values)})"


@dataclass(frozen=True, slots=True)
class DrawAxis:
    """A value of the spec, and its distribution."""

    path: str
    law: Bounds | Listed


@dataclass(frozen=True, slots=True)
class Draws:
    """The drawn values, the number of draws, and their seed."""

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
        """Rows that contain every choice, with lower bounds for numbers, for an early check."""
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
        """Keys drawn between bounds, whose values are all different."""
        return frozenset(axis.path for axis in self.axes if isinstance(axis.law, Bounds))


NO_DRAWS = Draws()


def draw_axes(given: Sequence[str] | Mapping[str, str]) -> tuple[DrawAxis, ...]:
    """Parses texts `parameters.k.init=log(1, 100) N/m`, or a mapping from key to distribution.

    Raises SpecError for other texts.
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
