"""Writes a spec that can be trained on a file of measured data immediately."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from backends.files.text_templates import text_templates
from msnn.data.dataset import BoolArray
from msnn.data.formats.table_of_formats import FileFormat, format_of, unread_suffix
from msnn.data.reading.read_file import taken_as_text
from msnn.errors.data.files import read_as_text
from msnn.features.data_check.errors import few_rows, no_target
from msnn.features.data_check.first_spec.baseline import (
    VALIDATION,
    Baseline,
    SeenDelay,
    choose_baseline,
    roles_of,
)
from msnn.features.data_check.first_spec.columns import (
    FoundColumn,
    FoundTable,
    free_name,
)
from msnn.features.data_check.first_spec.least_squares import largest_pole
from msnn.features.data_check.first_spec.recordings import Recordings, files_of, recordings_of
from msnn.project.new_project import IGNORED, SCHEMA_FILE, project_name, write_project
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.format_spec import format_spec
from spec_schema.editors.json_schema import json_schema_text
from spec_schema.yaml_tree.writer import quoted, scalar_text

_FEWEST_ROWS = 40
_WIDTH = 98
"""Width of notes in the spec, without the comment character."""


class TargetNotNamedError(Exception):
    """The predicted column is not given or unknown; the text lists candidates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewSpec:
    """The text of a spec, and notes for the user."""

    text: str
    notes: tuple[str, ...]


def spec_from_data(
    name: str, files: Path | Sequence[Path], folder: Path, predict: str | Sequence[str] | None
) -> NewSpec:
    """The spec of a model named `name` in `folder`, from the columns of files.

    Raises TargetNotNamedError if a predicted column is unknown, and SpecError if the files cannot
    be used.
    """
    named = [predict] if isinstance(predict, str) else list(dict.fromkeys(predict or ()))
    paths = files_of([files] if isinstance(files, Path) else files)
    try:
        return _spec_from_data(name, paths, folder, named)
    except SpecError as error:
        file = paths[0]
        raise SpecError(taken_as_text(file, file.name, error.diagnostics), error.sources) from error


def _spec_from_data(
    name: str, paths: Sequence[Path], folder: Path, named: Sequence[str]
) -> NewSpec:
    found = recordings_of(paths, VALIDATION)
    table, time = found.table, found.time
    used = [c for c in table.columns if c is not _again(time.column, table)]
    used = [c for c in used if c.index not in time.counters]
    moving = [c for c in used if c.moves]
    if not moving:
        raise SpecError([no_target(paths[0].name)])
    # where all are measured seldom there is no other row to be beside
    seldom = [c for c in moving if c.is_seldom]
    seldom = [] if len(seldom) == len(moving) else seldom
    moving = [c for c in moving if c not in seldom]
    still = [c for c in used if not c.moves]
    for called in named:
        if (text := table.text_in(called)) is not None:
            raise TargetNotNamedError(
                f"`{called}` is no column of numbers, `{text}` stands in it; "
                f"{_candidates(moving, still, found.follows)}"
            )
    if not named:
        raise TargetNotNamedError(_candidates(moving, still, found.follows))
    targets = [_target(called, moving, still, seldom, found.follows) for called in named]
    targets = [t for i, t in enumerate(targets) if all(t is not other for other in targets[:i])]
    # fewer rows than a handful of parameters can be told from
    if min(int(np.sum(np.isfinite(target.values))) for target in targets) < _FEWEST_ROWS:
        raise SpecError([few_rows(paths[0].name, found.rows, _FEWEST_ROWS)])
    # targets explain no other column: what follows them is no input
    roles = [
        role
        for role in roles_of(moving, found.follows, targets)
        if all(role.column is not target for target in targets)
    ]
    # where everything looks like an output all of it may drive the target
    inputs = [r.column for r in roles if not r.output] or [r.column for r in roles]
    others = [r.column for r in roles if all(r.column is not column for column in inputs)]
    facts = _Facts(
        name=name,
        recordings=found,
        folder=folder,
        targets=targets,
        others=others,
        still=still,
        seldom=seldom,
        baseline=choose_baseline(targets, inputs, found.follows, found.held_out),
    )
    return NewSpec(text=format_spec(f"{name}.msnn.yaml", _text(facts)), notes=facts.notes)


def _again(column: FoundColumn | None, table: FoundTable) -> FoundColumn | None:
    """The column of a table with the values of all files."""
    return (
        None
        if column is None
        else next((c for c in table.columns if c.index == column.index), None)
    )


def _target(
    called: str,
    columns: Sequence[FoundColumn],
    still: Sequence[FoundColumn],
    seldom: Sequence[FoundColumn],
    row_follows: BoolArray,
) -> FoundColumn:
    """The column with this name or header, with or without unit."""
    found = [c for c in columns if called in (c.name, c.label)]
    if len(found) != 1:
        held = next((c for c in still if called in (c.name, c.label)), None)
        message = f"no column that moves is called `{called}`"
        if held is not None:
            message = f"`{called}` {_stillness(held)}: record it while it moves"
        rare = next((c for c in seldom if called in (c.name, c.label)), None)
        if rare is not None:
            message = f"`{called}` {rare.how_often}: a linear model needs rows one after another"
        raise TargetNotNamedError(f"{message}; {_candidates(columns, still, row_follows)}")
    return found[0]


def _stillness(column: FoundColumn) -> str:
    values = column.values[np.isfinite(column.values)]
    if not len(values):
        return "has no number in any row"
    return f"is {values[0]:.6g} in every row that has a number"


def _candidates(
    columns: Sequence[FoundColumn], still: Sequence[FoundColumn], row_follows: BoolArray
) -> str:
    roles = roles_of(columns, row_follows)
    outputs = sorted((r for r in roles if r.output), key=lambda role: -role.explained)
    inputs = [r.column for r in roles if not r.output]
    text = f"columns that look like outputs: {_listed([r.column for r in outputs])}"
    text += f"; like inputs: {_listed(inputs)}"
    if still:
        text += f"; without any change: {_listed(still)}"
    # an example that works when it is copied
    first = (outputs or roles)[0].column.name
    return f"{text}; say which one to predict, such as `--predict {first}`"


_LISTED = 12


def _listed(columns: Sequence[FoundColumn]) -> str:
    names = [column.name for column in columns]
    more = f", … ({len(names)} in all)" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more if names else "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Facts:
    name: str
    recordings: Recordings
    folder: Path
    targets: Sequence[FoundColumn]
    others: Sequence[FoundColumn]
    still: Sequence[FoundColumn]
    seldom: Sequence[FoundColumn]
    baseline: Baseline

    @property
    def columns(self) -> list[FoundColumn]:
        """The columns of the model, targets first."""
        return [*self.targets, *self.baseline.inputs]

    @property
    def notes(self) -> tuple[str, ...]:
        left_out = [each.column for each in self.baseline.left_out]
        columns = (*self.columns, *left_out, *self.others)
        table = self.recordings.table
        dropped = [f"`{table.layout.labels[index]}`" for index in table.texts]
        if table.dates is not None:
            dropped = [each for each in dropped if each != f"`{table.dates.label}`"]
        texts = (f"columns without numbers are left out: {', '.join(dropped)}",) if dropped else ()
        suffix = unread_suffix(self.recordings.files[0])
        # before all else: every column may be another one
        as_text = () if suffix is None else (read_as_text(suffix).message,)
        return (
            *as_text,
            *self.recordings.time.notes,
            *texts,
            *(note for column in columns for note in column.doubts),
            *(c.renamed for c in columns if c.renamed),
            *(
                f"`{each.column.name}` is left out: it {each.reason}"
                for each in self.baseline.left_out
            ),
            *(
                f"`{column.name}` is left out: it looks like an output too"
                for column in self.others
            ),
        )


def _text(facts: _Facts) -> str:
    environment = text_templates(
        "project",
        strips=True,
        quoted=quoted,
        scalar=partial(scalar_text, in_flow=True),
        comment=_comment,
    )
    return environment.get_template("from_data.yaml.j2").render(_values(facts))


def _values(facts: _Facts) -> dict[str, Any]:
    baseline, found = facts.baseline, facts.recordings
    time, table, columns = found.time, found.table, facts.columns
    signals = [*baseline.inputs, *facts.targets]
    taken = {column.name for column in table.columns}
    # only of what the spec reads: other columns may have gaps as they like
    lacking = [c for c in signals if not np.isfinite(c.values).all()]
    paths = [os.path.relpath(file.resolve(), facts.folder.resolve()) for file in found.files]
    shown = found.files[0].name
    if len(paths) > 1:
        shown += f" and {len(paths) - 1} more files"
    return {
        "name": facts.name,
        "file": shown,
        "paths": paths,
        "rows": found.rows,
        "notes": [line for note in facts.notes for line in wrap(_printable(note), _WIDTH)],
        "sample_time": _duration(time.step),
        "signals": [_signal(column) for column in signals],
        "others": [_signal(column) for column in facts.others],
        "left_out": [{"name": e.column.name, "reason": e.reason} for e in baseline.left_out],
        "still": [_signal(column) for column in facts.still],
        "seldom": [{"name": c.name, "how_often": c.how_often} for c in facts.seldom],
        "targets": [
            _of_target(facts, number, columns, taken) for number in range(len(facts.targets))
        ],
        "time": None
        if time.column is None
        else {"key": _key(time.column.key), "unit": None if time.unit == "s" else time.unit},
        "csv": _csv(table, format_of(found.files[0])),
        "resample": time.resample,
        "nan": "split" if lacking else None,
        # whole recordings, as they are validated; errors of an unstable model would grow
        "rollout": "horizon: record"
        if largest_pole(baseline.equations) < 1
        else f"horizon: {baseline.horizon}, stride: {max(baseline.horizon // 2, 1)}",
    }


def _of_target(
    facts: _Facts, number: int, columns: Sequence[FoundColumn], taken: set[str]
) -> dict[str, Any]:
    """The names and numbers of the equation of one target."""
    baseline, target = facts.baseline, columns[number]
    equation = baseline.equations[number]
    several = len(facts.targets) > 1
    before = f"{target.name}_" if several else ""
    unit = "" if target.unit is None else f" {target.unit.text}"
    step = facts.recordings.time.step
    layers: list[dict[str, Any]] = []
    for term, taps in zip(equation.terms, equation.taps, strict=True):
        column = columns[term.column]
        seen = baseline.delays.get((number, term.column))
        layers.append(
            {
                "name": free_name(f"{before}from_{column.name}", taken),
                "argument": column.name
                if term.first == 1
                else f"{column.name}[t-{term.first - 1}]",
                "window": equation.order,
                # a layer has the oldest sample first
                "weights": ", ".join(_weight(tap) for tap in taps[::-1]),
                # its own past needs no remark
                "seen": "" if seen is None else _seen(seen, term.first, step),
            }
        )
    return {
        "name": target.name,
        "unit": None if target.unit is None else target.unit.text,
        "layers": layers,
        "level": _weight(equation.offset),
        "offset": free_name(f"{before}offset", taken),
        "linear": free_name(f"{before}linear", taken),
        "output": free_name(f"{target.name}_next", taken),
        "constant": f"{baseline.constant_errors[number]:.3g}{unit}",
        "held": f"{baseline.held_errors[number]:.3g}{unit}",
    }


def _weight(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


def _seen(seen: SeenDelay, first: int, step: float) -> str:
    if seen.is_immediate:
        return "answers in the same row, of which a prediction knows nothing yet"
    if not seen.is_seen:
        return "its first answer is not visible"
    return f"answers after {first} rows, {_duration(first * step)}" if first > 1 else ""


def _signal(column: FoundColumn) -> dict[str, Any]:
    known = column.values[np.isfinite(column.values)]
    low, high = _rounded(float(np.min(known)), float(np.max(known)))
    return {
        "name": column.name,
        "unit": None if column.unit is None else column.unit.text,
        "range": f"[{low!r}, {high!r}]" if low < high else None,
        "label": _comment(column.label),
        "key": _key(column.key),
        "named": column.key == column.name and column.unit is None,
    }


def _rounded(low: float, high: float) -> tuple[float, float]:
    """The range rounded outwards to two digits of its span."""
    if not high > low:
        return low, high
    # decimals of two digits of the span
    digits = 1 - math.floor(math.log10(high - low))
    grain = 10.0**digits
    return float(f"{math.floor(low * grain) / grain:.12g}"), float(
        f"{math.ceil(high * grain) / grain:.12g}"
    )


def _key(key: str | int) -> str:
    return str(key) if isinstance(key, int) else quoted(key)


def _csv(table: FoundTable, format: FileFormat) -> str | None:
    """The `csv:` entry with keys that the format uses; None for the default layout."""
    dialect, entries = table.layout.dialect, dict[str, str]()
    if dialect.delimiter != ",":
        entries["delimiter"] = quoted(dialect.delimiter)
    if dialect.decimal != ".":
        entries["decimal"] = quoted(dialect.decimal)
    if dialect.comment is not None:
        entries["comment"] = quoted(dialect.comment)
    if not dialect.header:
        entries["header"] = "false"
    if dialect.skip:
        entries["skip"] = str(dialect.skip)
    used = [f"{key}: {value}" for key, value in entries.items() if key in format.text_keys]
    return ", ".join(used) or None


def _duration(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.6g} {unit}"
    return f"{seconds / 1e-6:.6g} us"


def _comment(text: str) -> str:
    """The text without characters that would end or hide a comment."""
    return _printable(text)[:80]


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def new_project_from(
    folder: Path, data: Sequence[Path], predict: Sequence[str]
) -> tuple[Path, NewSpec]:
    """Creates a project for measured data, which are not copied.

    Raises the errors of `new_project` and `spec_from_data`.
    """
    name = project_name(folder)
    spec = spec_from_data(name, data, folder, predict)
    texts = {
        f"{name}.msnn.yaml": spec.text,
        "README.md": text_templates("project").get_template("README_data.md.j2").render(name=name),
        ".gitignore": IGNORED,
        SCHEMA_FILE: json_schema_text(),
    }
    return write_project(folder, texts), spec
