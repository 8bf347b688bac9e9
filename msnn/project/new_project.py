"""Creates the folder of a new project: a working spec, a little training data, a README."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from backends.files.atomic_write import naming
from backends.files.text_templates import text_templates
from backends.ports.identifiers import c_identifier
from msnn.errors.commands import folder_exists, unusable_name
from msnn.project.sample_data import sample_records
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.json_schema import json_schema_text
from spec_schema.names import LONGEST_NAME, is_name, why_reserved

SCHEMA_FILE = "msnn.schema.json"
IGNORED = "build/\nruns/\n"
"""The `.gitignore` of a project."""


def new_project(folder: Path) -> Path:
    """Creates the folder atomically; its name becomes that of the model.

    Raises SpecError if the folder exists or its name is invalid, and OSError.
    """
    name = project_name(folder)
    return write_project(folder, _texts(name))


def project_name(folder: Path) -> str:
    """The name of the model; SpecError if it is invalid, or if the folder exists."""
    name = folder.name
    wrong = f"it is not a word of at most {LONGEST_NAME} letters and digits"
    reason = wrong if not is_name(name) else why_reserved(name)
    if reason is not None:
        raise SpecError([unusable_name(name or str(folder), reason)])
    if folder.exists():
        raise SpecError([folder_exists(str(folder))])
    return name


def write_project(folder: Path, texts: Mapping[str, str]) -> Path:
    """Writes the folder with texts by file path. Raises OSError."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    # on the same disk, where a rename is one operation: the folder is there whole or not at all
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as place:
        made = Path(place) / folder.name
        for file, text in texts.items():
            path = made / file
            path.parent.mkdir(parents=True, exist_ok=True)
            # an error of the system names the file that the user would have got, not the one in
            # between
            with naming(folder / file):
                path.write_text(text, encoding="utf-8", newline="\n")
        made.rename(folder)
    return folder


def _texts(name: str) -> dict[str, str]:
    environment = text_templates("project")
    facts = {"name": name, "prefix": c_identifier(name, set())}
    return {
        f"{name}.msnn.yaml": environment.get_template("spec.yaml.j2").render(facts),
        "README.md": environment.get_template("README.md.j2").render(facts),
        ".gitignore": IGNORED,
        SCHEMA_FILE: json_schema_text(),
        **{f"data/{file}": text for file, text in sample_records().items()},
    }
