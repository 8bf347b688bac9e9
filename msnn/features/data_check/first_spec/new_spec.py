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
from msnn.features.data_check.first_spec.baseline import Baseline, choose_baseline, roles_of
from msnn.features.data_check.first_spec.columns import (
    FoundColumn,
    FoundTable,
    columns_of,
    free_name,
)
from msnn.features.data_check.first_spec.time_column import FoundTime, time_of
from msnn.features.data_check.sampling import follows
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


def spec_from_data(name: str, file: Path, folder: Path, predict: str | None) -> NewSpec:
    """The spec of a model named `name` in `folder`, from the columns of a file.

    Raises TargetNotNamedError if the predicted column is unknown, and SpecError if the file cannot
    be used.
    """
    try:
        return _spec_from_data(name, file, folder, predict)
    except SpecError as error:
        raise SpecError(taken_as_text(file, file.name, error.diagnostics), error.sources) from error


def _spec_from_data(name: str, file: Path, folder: Path, predict: str | None) -> NewSpec:
    table = columns_of(file)
    time = time_of(table, file.name)
    row_follows = follows(None if time.column is None else time.column.values, table.rows)
    used = [c for c in table.columns if c is not time.column and c.index not in time.counters]
    moving = [c for c in used if c.moves]
    if not moving:
        raise SpecError([no_target(file.name)])
    # where all are measured seldom there is no other row to be beside
    seldom = [c for c in moving if c.is_seldom]
    seldom = [] if len(seldom) == len(moving) else seldom
    moving = [c for c in moving if c not in seldom]
    still = [c for c in used if not c.moves]
    text = None if predict is None else table.text_in(predict)
    if text is not None:
        raise TargetNotNamedError(
            f"`{predict}` is no column of numbers, `{text}` stands in it; "
            f"{_candidates(moving, still, row_follows)}"
        )
    target = _target(predict, moving, still, seldom, row_follows)
    # fewer rows than a handful of parameters can be told from
    if np.sum(np.isfinite(target.values)) < _FEWEST_ROWS:
        raise SpecError([few_rows(file.name, table.rows, _FEWEST_ROWS)])
    # `target` explains no other column: what follows it is no input
    roles = [r for r in roles_of(moving, row_follows, target) if r.column is not target]
    # where everything looks like an output all of it may drive the target
    inputs = [r.column for r in roles if not r.output] or [r.column for r in roles]
    others = [r.column for r in roles if r.column not in inputs]
    baseline = choose_baseline(target, inputs, row_follows)
    facts = _Facts(
        name=name,
        file=file,
        folder=folder,
        table=table,
        time=time,
        target=target,
        inputs=inputs,
        others=others,
        still=still,
        seldom=seldom,
        baseline=baseline,
    )
    return NewSpec(text=format_spec(f"{name}.msnn.yaml", _text(facts)), notes=facts.notes)


def _target(
    predict: str | None,
    columns: Sequence[FoundColumn],
    still: Sequence[FoundColumn],
    seldom: Sequence[FoundColumn],
    row_follows: BoolArray,
) -> FoundColumn:
    """The column with this name or header, with or without unit."""
    if predict is None:
        raise TargetNotNamedError(_candidates(columns, still, row_follows))
    found = [c for c in columns if predict in (c.name, c.label)]
    if len(found) != 1:
        held = next((c for c in still if predict in (c.name, c.label)), None)
        message = f"no column that moves is called `{predict}`"
        if held is not None:
            message = f"`{predict}` {_stillness(held)}: record it while it moves"
        rare = next((c for c in seldom if predict in (c.name, c.label)), None)
        if rare is not None:
            message = f"`{predict}` {rare.how_often}: a linear model needs rows one after another"
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
    file: Path
    folder: Path
    table: FoundTable
    time: FoundTime
    target: FoundColumn
    inputs: Sequence[FoundColumn]
    others: Sequence[FoundColumn]
    still: Sequence[FoundColumn]
    seldom: Sequence[FoundColumn]
    baseline: Baseline

    @property
    def notes(self) -> tuple[str, ...]:
        columns = (self.target, *self.inputs, *self.others)
        suffix = unread_suffix(self.file)
        # before all else: every column may be another one
        as_text = () if suffix is None else (read_as_text(suffix).message,)
        doubts = (note for column in columns for note in column.doubts)
        return (*as_text, *self.time.notes, *doubts)


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
    target, baseline, time = facts.target, facts.baseline, facts.time
    signals = [*facts.inputs, target]
    taken = {column.name for column in facts.table.columns}
    unit = "" if target.unit is None else f" {target.unit.text}"
    layers = [
        {
            "name": free_name(f"from_{column.name}", taken),
            "argument": column.name if delay == 1 else f"{column.name}[t-{delay - 1}]",
            "window": baseline.order,
            "seen": _seen(delay, seen, immediate, time.step),
        }
        for column, delay, seen, immediate in zip(
            [target, *facts.inputs],
            (1, *baseline.delays),
            (True, *baseline.seen),
            (False, *baseline.immediate),
            strict=True,
        )
    ]
    # its own past needs no remark
    layers[0]["seen"] = ""
    # only of what the spec reads: other columns may have gaps as they like
    lacking = [c for c in signals if not np.isfinite(c.values).all()]
    return {
        "name": facts.name,
        "file": facts.file.name,
        "path": os.path.relpath(facts.file.resolve(), facts.folder.resolve()),
        "rows": facts.table.rows,
        "notes": [line for note in facts.notes for line in wrap(_printable(note), _WIDTH)],
        "sample_time": _duration(time.step),
        "signals": [_signal(column) for column in signals],
        "others": [_signal(column) for column in facts.others],
        "still": [_signal(column) for column in facts.still],
        "seldom": [{"name": c.name, "how_often": c.how_often} for c in facts.seldom],
        "layers": layers,
        "offset": free_name("offset", taken),
        "linear": free_name("linear", taken),
        "output": free_name(f"{target.name}_next", taken),
        "target": target.name,
        "unit": None if target.unit is None else target.unit.text,
        "level": float(f"{np.nanmean(target.values):.3g}"),
        "time": None
        if time.column is None
        else {"key": _key(time.column.key), "unit": None if time.unit == "s" else time.unit},
        "csv": _csv(facts.table, format_of(facts.file)),
        "resample": time.resample,
        "nan": "split" if lacking else None,
        "horizon": baseline.horizon,
        "stride": max(baseline.horizon // 2, 1),
        "constant": f"{baseline.constant_error:.3g}{unit}",
        "held": f"{baseline.held_error:.3g}{unit}",
    }


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


def _seen(delay: int, seen: bool, immediate: bool, step: float) -> str:
    if immediate:
        return "answers in the same row, of which a prediction knows nothing yet"
    if not seen:
        return "no answer is seen in the data"
    return f"answers after {delay} rows, {_duration(delay * step)}" if delay > 1 else ""


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


def new_project_from(folder: Path, data: Path, predict: str | None) -> tuple[Path, NewSpec]:
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
