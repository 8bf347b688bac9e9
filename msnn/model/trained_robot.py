"""Compares the robots of a model with those that the run of its weights has kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from msnn.errors.learning.weights import weights_of_another_model
from msnn.model.saved_run import PARTS
from msnn.model.spec_hash import SubmodelFile
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.endless_files import refuse_endless
from spec_schema.robots.urdf import Urdf, read_urdf

_Part = TypeVar("_Part")


def refuse_other_robot(parts: Sequence[SubmodelFile], weights: Path) -> None:
    """Raises SpecError where a URDF describes another robot than the one that a run has kept.

    A run that has kept none, as a program file's has, says nothing.
    """
    for part in parts:
        kept = weights.parent / PARTS / part.kept_as
        if part.is_robot and kept.is_file():
            differing = differing_robot(kept, part.text)
            if differing is not None:
                said = [f"of the robot `{part.name}` {differing}"]
                urdf = f"the URDF `{PARTS}/{part.kept_as}`"
                raise SpecError([weights_of_another_model(str(weights), said, kept=urdf)])


def differing_robot(kept: Path, text: str) -> str | None:
    """The difference of a URDF from the file of a run; None where both are one robot.

    Comments, names of meshes and all else that no model reads count for nothing.
    """
    try:
        refuse_endless(kept)
        before = kept.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return "nothing that could be read was kept"
    # almost always, and cheaper than reading both
    if before == text:
        return None
    then, now = _read(kept.name, before), _read(kept.name, text)
    if then is None or now is None:
        return "the URDF has another text"
    for kind, old, new in (("link", then.links, now.links), ("joint", then.joints, now.joints)):
        name = _first_differing(old, new)
        if name is not None:
            return f"the {kind} `{name}` is another one"
    # their order is that of the elements of positions and torques
    if list(then.joints) != list(now.joints):
        return "the joints stand in another order"
    return None


def _read(name: str, text: str) -> Urdf | None:
    return read_urdf(SourceText(name, text), Findings())


def _first_differing(old: Mapping[str, _Part], new: Mapping[str, _Part]) -> str | None:
    return next((name for name in {**new, **old} if old.get(name) != new.get(name)), None)
