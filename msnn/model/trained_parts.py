"""Compares parts of a model that are no specs with those that the run of its weights has kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msnn.errors.learning.weights import weights_of_another_model
from msnn.model.saved_run import PARTS
from msnn.model.spec_hash import SubmodelFile
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import refuse_endless
from spec_schema.registry import PartLine
from spec_schema.sections.submodels import part_kind


def refuse_other_parts(parts: Sequence[SubmodelFile], weights: Path) -> None:
    """Raises SpecError where the file of a part describes another one than a run has kept.

    A run that has kept none, as a program file's has, says nothing.
    """
    for part in parts:
        kept = weights.parent / PARTS / part.kept_as
        if part.line is not None and kept.is_file():
            difference = part_difference(part.line, kept, part.text)
            if difference is not None:
                differing = [f"of the {part.line.title} `{part.name}` {difference}"]
                file = f"the {part.line.file_title} `{PARTS}/{part.kept_as}`"
                raise SpecError([weights_of_another_model(str(weights), differing, kept=file)])


def part_difference(line: PartLine, kept: Path, text: str) -> str | None:
    """The difference of a part from the file of a run; None where both are one part."""
    try:
        refuse_endless(kept)
        before = kept.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return "nothing that could be read was kept"
    # almost always, and cheaper than reading both
    return None if before == text else part_kind(line).difference(before, text)
