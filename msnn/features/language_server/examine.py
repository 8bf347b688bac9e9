"""Checks a spec as `msnn check` does and keeps what editors show of it."""

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
    """All that is to be said of a text, and what is known of the model where it compiles."""

    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, SourceText] = field(default_factory=dict[str, SourceText])
    """The texts that places point into, by path."""
    knowledge: Knowledge | None = None


def examine(path: str, text: str, unsaved: Mapping[str, str]) -> Examined:
    """Runs `msnn check` on `text` at `path`, where open files hold in place of saved ones.

    `unsaved` are texts of files by their real paths.
    """
    try:
        model = checked_model(Path(path), text=text, unsaved=unsaved)
    except SpecError as error:
        # without knowledge: that of the last text that compiled stays in use
        return Examined(error.diagnostics, {source.path: source for source in error.sources})
    sources = {source.path: source for source in model.sources}
    return Examined(model.warnings, sources, knowledge_of(model))
