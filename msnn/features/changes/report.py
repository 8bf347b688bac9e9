"""Formats changes between two models: text, Markdown, JSON values and messages."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import asdict
from typing import Any

from msnn.errors.data.rows import listed
from msnn.features.changes.errors import breaking_change, worse_metric
from msnn.features.changes.model_changes import FailOn, MetricChange, ModelChanges
from msnn.reports.compare_specs import SpecDifference
from msnn.tables import Table, count
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import printable, printable_json


def changes_text(found: ModelChanges, margin: float) -> str:
    """The changes as text for a terminal: entries of the spec, then tables, then a one-line
    summary. `margin` is that of `ModelChanges.worse`.
    """
    tables = [table.text for table in _tables(found, margin)]
    parts = [_specs_text(found.specs), *tables, verdict(found, margin)]
    return "\n\n".join(part for part in parts if part)


def changes_markdown(found: ModelChanges, margin: float) -> str:
    """The changes as Markdown: a heading with the summary, tables, and entries of the spec in a
    folded block. `margin` is that of `ModelChanges.worse`.
    """
    head = f"## {found.name}: {verdict(found, margin)}"
    parts = [head, *(table.markdown for table in _tables(found, margin))]
    if specs := _specs_text(found.specs):
        # docs of a spec may hold fences of their own
        fence = "`" * (3 + specs.count("```"))
        shown = f"{fence}text\n{specs}\n{fence}"
        parts.append(f"<details><summary>Changes of the spec</summary>\n\n{shown}\n\n</details>")
    return "\n\n".join(parts) + "\n"


def changes_record(found: ModelChanges, margin: float) -> dict[str, Any]:
    """All changes between the models as a JSON object; `margin` is that of `ModelChanges.worse`."""
    specs, worse = found.specs, found.worse(margin)
    return {
        "same": specs.is_same,
        "kind": specs.kind,
        "renames": specs.renames or {},
        "changes": [{"path": c.path, "old": c.old, "new": c.new} for c in specs.changes],
        "breaking": bool(found.breaking),
        "interface": [_without_span(asdict(change)) for change in found.interface],
        "worse": bool(worse),
        "metrics": [
            {**_without_span(asdict(change)), "worse": change in worse} for change in found.metrics
        ],
        "learned": [asdict(each) for each in found.learned],
        "plugins": [asdict(each) for each in found.plugins],
    }


def failures(found: ModelChanges, on: Collection[FailOn], margin: float) -> list[Diagnostic]:
    """The diagnostics that fail a pipeline: E0872 for each breaking change if `on` has `breaking`,
    E0871 for each metric beyond `margin` if it has `worse`. `any` gives no diagnostic here.
    """
    said: list[Diagnostic] = []
    if "breaking" in on:
        for change in found.breaking:
            what = f"{change.what} " if change.what else ""
            words = f"{what}{change.old or 'nothing'} → {change.new or 'gone'}"
            said.append(breaking_change(change.part, words, change.breaks, change.span))
    if "worse" in on:
        for row in found.worse(margin):
            what = f"{row.metric} of `{row.of}` ({row.rollout}, {row.data})"
            old, new = (f"{_number(value)} {row.unit}".strip() for value in (row.old, row.new))
            said.append(worse_metric(what, old, new, _grown(row), row.span))
    return said


def verdict(found: ModelChanges, margin: float) -> str:
    """The summary in one line, such as `the models differ; 1 change of the interface breaks those
    who use it`. `margin` is that of `ModelChanges.worse`.
    """
    sections = listed([f"`{name}`" for name in found.specs.workflow])
    parts = [_SAID[found.specs.kind].format(sections=sections)]
    if breaking := len(found.breaking):
        verb = "breaks" if breaking == 1 else "break"
        parts.append(f"{count(breaking, 'change')} of the interface {verb} those who use it")
    if found.metrics:
        worse = len(found.worse(margin))
        verb = "is" if worse == 1 else "are"
        parts.append(f"{count(worse, 'metric')} {verb} worse" if worse else "no metric is worse")
    return "; ".join(parts)


_SAID = {
    "same": "the same",
    "text": "the same model: only its text differs, such as comments or layout",
    "renamed": "only renamed: all formulas and settings are the same",
    "workflow": "the same model: its workflow differs in {sections}",
    "model": "the models differ",
}


def _specs_text(found: SpecDifference) -> str:
    if found.kind == "renamed":
        return "\n".join(f"{old} → {new}" for old, new in (found.renames or {}).items())
    lines: list[str] = []
    for change in found.changes:
        lines.append(printable(change.path))
        lines += [] if change.old is None else [f"  - {_shown(change.old)}"]
        lines += [] if change.new is None else [f"  + {_shown(change.new)}"]
    return "\n".join(lines)


def _tables(found: ModelChanges, margin: float) -> Iterator[Table]:
    if found.interface:
        rows = [(c.part, c.what, c.old or "", c.new or "", c.breaks) for c in found.interface]
        yield Table(("interface", "", "old", "new", "breaks, since"), rows)
    if found.metrics:
        worse = found.worse(margin)
        rows = [
            (
                row.of,
                row.metric,
                _number(row.old),
                _number(row.new),
                row.unit,
                _grown(row),
                "WORSE" if row in worse else "",
                row.rollout,
                row.data,
                row.note,
            )
            for row in found.metrics
        ]
        header = ("of", "metric", "old", "new", "unit", "error", "", "rollout", "data", "note")
        yield Table(header, rows, (2, 3))
    if found.learned:
        rows = [(p.name, p.unit, _number(p.old), _number(p.new)) for p in found.learned]
        yield Table(("parameter", "unit", "old", "new"), rows, (2, 3))
    if found.plugins:
        rows = [(each.package, each.old or "", each.new or "") for each in found.plugins]
        yield Table(("plug-in", "old", "new"), rows)


def _grown(row: MetricChange) -> str:
    return "" if row.growth is None else f"{row.growth:+.1%}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _shown(value: Any) -> str:
    # quoted where it has more than one line: a doc would begin lines of the log
    is_plain = isinstance(value, str) and value == printable(value)
    return value if is_plain else printable_json(json.dumps(value, ensure_ascii=False))


def _without_span(record: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key != "span"}
