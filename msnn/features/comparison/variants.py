"""Enumerates the models of a comparison: specs, each with every choice of the grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TypeAlias

from msnn.features.comparison.errors import comparison as errors
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
    """A spec with overridden values."""

    spec: Path
    settings: tuple[str, ...]
    """Common settings, then those of the variant: `layers.h.fir.window=10`."""
    label: str
    """A label that distinguishes it from other variants."""
    drawn_by: int | None = None
    """The seed of the draws, if it was drawn."""


@dataclass(frozen=True, slots=True)
class GridAxis:
    """A value of the spec, and the values to try."""

    path: str
    values: tuple[str, ...]
    """Values in YAML syntax."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """Drawn values of these paths, one row per draw."""

    paths: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    seed: int | None


def grid_axis(text: str) -> GridAxis:
    """Parses `layers.h.fir.window=5,10,20`; values are YAML, lists and mappings in brackets.

    Raises SpecError for other texts.
    """
    path, equals, values = text.partition("=")
    # a line break would make two settings of one
    found = listed_values(values) if path.strip() and equals and "\n" not in path else None
    if found is None:
        raise SpecError((errors.malformed_grid(text),))
    return GridAxis(one_path(path), found)


def grid_axes(grid: Grid) -> list[GridAxis]:
    """The axes of texts, or of a mapping from path to values. Raises SpecError."""
    if isinstance(grid, Mapping):
        return [
            GridAxis(one_path(path), tuple(map(value_text, values)))
            for path, values in grid.items()
        ]
    return [grid_axis(each) for each in grid]


def listed_values(text: str) -> tuple[str, ...] | None:
    """The YAML values between commas on one line, verbatim; None if the text is invalid."""
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

    The last axis varies fastest, draws slowest.
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
    """The shortest distinct suffixes of paths: `window`, or `f.window` and `g.window`."""
    steps = [path.split(".") for path in paths]
    for depth in range(1, max(map(len, steps), default=1)):
        ends = [".".join(each[-depth:]) for each in steps]
        # `0.epochs` says nothing without `train` before it
        if len(set(ends)) == len(ends) and not any(end[0].isdecimal() for end in ends):
            return ends
    return list(paths)
