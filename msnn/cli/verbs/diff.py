"""`msnn diff`: what changed between two models, apart from comments and layout."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from msnn.cli.arguments import (
    NewSettings,
    OldSettings,
    OutputFormat,
    ResultFormat,
    Settings,
)
from msnn.cli.exit_codes import ExitCode

if TYPE_CHECKING:
    from msnn.reports.compare_specs import Comparison


def diff(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="A spec, or a program file.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="A spec, or a program file.")],
    settings: Settings = None,
    old_settings: OldSettings = None,
    new_settings: NewSettings = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Say what changed between two models.

    Entry by entry, with shorthands written out: interface, units, parameters, equations, states,
    losses, stages. `--set` replaces a value of both; with SPEC twice, `--set-new` shows what a
    setting changes. Exit code 0 when both mean the same, 1 when they differ.
    """
    from msnn.cli.console import json_result, result
    from msnn.model.load import load_model
    from msnn.reports.compare_specs import compare_specs

    of_both = tuple(settings or ())
    found = compare_specs(
        load_model(old, (*of_both, *(old_settings or ()))),
        load_model(new, (*of_both, *(new_settings or ()))),
    )
    if format is ResultFormat.JSON:
        changes = [{"path": c.path, "old": c.old, "new": c.new} for c in found.changes]
        record: dict[str, Any] = {"same": found.is_same, "kind": found.kind}
        json_result("diff", record | {"renames": found.renames or {}, "changes": changes})
    else:
        result(_text(found))
    if not found.is_same:
        raise typer.Exit(ExitCode.DIAGNOSTICS)


def _text(found: Comparison) -> str:
    lines: list[str] = []
    if found.kind != "renamed":
        for change in found.changes:
            lines.append(change.path)
            lines += [] if change.old is None else [f"  - {_shown(change.old)}"]
            lines += [] if change.new is None else [f"  + {_shown(change.new)}"]
        lines += [""] if lines else []
    match found.kind:
        case "same":
            lines.append("the same")
        case "text":
            lines.append("the same model: only its text differs, such as comments or layout")
        case "renamed":
            renames = (found.renames or {}).items()
            lines += [f"{old} → {new}" for old, new in renames]
            lines += ["", "only renamed: all formulas and settings are the same"]
        case "workflow":
            lines.append("the same model: how it is trained, validated or exported differs")
        case "model":
            lines.append("the models differ")
    return "\n".join(lines)


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
