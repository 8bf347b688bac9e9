"""Creates the folder of a project from measured data: a first spec, a README."""

from __future__ import annotations

from pathlib import Path

from backends.files.text_templates import text_templates
from msnn.features.data_check.first_spec.new_spec import NewSpec, spec_from_data
from msnn.project.new_project import IGNORED, SCHEMA_FILE, project_name, write_project
from spec_schema.editors.json_schema import json_schema_text


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
