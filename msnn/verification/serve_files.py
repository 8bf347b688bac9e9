"""Writes the C code with which firmware serves the golden vectors on a serial line."""

from __future__ import annotations

from pathlib import Path

from backends.files.atomic_write import write_text
from msnn.exports.foreign_files import spare_foreign_files
from msnn.verification.builds.harness import harness_text
from msnn.verification.exported_c import read_exported_c
from msnn.verification.verified_export import verified_exports
from spec_schema.diagnostics.diagnostic import SpecError


def write_serve_files(export: Path, folder: Path) -> tuple[Path, ...]:
    """Writes three files for the export in a folder; SpecError (E1046, E1325) if there is none.

    Raises SpecError (E1054) if other files would be replaced.
    """
    for kind in verified_exports():
        if (other := kind.read(export)) is not None:
            raise SpecError([kind.on_board(other.prefix)])
    model = read_exported_c(export)
    names = {
        "replay.h": "replay.h",
        "board_answer.h": "board_answer.h",
        "board_serve.c": f"{model.prefix}_serve.c",
    }
    spare_foreign_files(folder / name for name in names.values())
    return tuple(
        write_text(folder / name, harness_text(template, model)) for template, name in names.items()
    )
