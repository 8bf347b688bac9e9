"""Reads models saved by other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from msnn.features.nnodely.written import WrittenImport


def import_nnodely(file: str | Path, out: str | Path | None = None) -> WrittenImport:
    """Writes the spec and the weights of a model that nnodely 1.x saved as JSON.

        written = msnn.import_nnodely("plant.json")
        model = msnn.load(written.spec)
        (run,) = msnn.simulate(model, frames, written.weights)

    `out` is the spec, by default the file's name with the ending `.msnn.yaml`; the weights are
    written next to it. Raises SpecError if a value or relation does not have nnodely's format, if a
    function cannot be translated, or if one of the files exists.
    """
    from msnn.features.nnodely.written import write_import

    return write_import(Path(file), None if out is None else Path(out))
