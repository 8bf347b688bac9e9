"""Checks a spec like `msnn check`, and collects information for editors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from msnn.features.language_server.knowledge import Knowledge, knowledge_of
from msnn.project.workflow_checks import checked_model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import SourceText


@dataclass(frozen=True)
class Examined:
    """The diagnostics of a text, and information about the model if it compiles."""

    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, SourceText] = field(default_factory=dict[str, SourceText])
    """The texts that diagnostics point into, by path."""
    knowledge: Knowledge | None = None


def examine(path: str, text: str, unsaved: Mapping[str, str]) -> Examined:
    """Runs `msnn check` on `text` at `path`.

    `unsaved` maps real paths to texts that replace saved files.
    """
    try:
        model = checked_model(Path(path), text=text, unsaved=unsaved)
    except SpecError as error:
        # without knowledge: that of the last text that compiled stays in use
        return Examined(error.diagnostics, {source.path: source for source in error.sources})
    sources = {source.path: source for source in model.sources}
    return Examined(model.warnings, sources, knowledge_of(model))
