"""Creates the folder of a new project: a working spec, simulated recordings, a README."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backends.files.atomic_write import naming
from backends.files.text_templates import text_templates
from backends.ports.identifiers import c_identifier
from msnn.errors.commands import folder_exists, unusable_name
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
    """The name of a project's model, that of its folder.

    Raises SpecError if the name is invalid, or if the folder exists.
    """
    name = folder.name
    wrong = f"it is not a word of at most {LONGEST_NAME} letters and digits"
    reason = wrong if not is_name(name) else why_reserved(name)
    if reason is not None:
        raise SpecError([unusable_name(name or str(folder), reason)])
    if folder.exists():
        raise SpecError([folder_exists(str(folder))])
    return name


def write_project(folder: Path, texts: Mapping[str, str]) -> Path:
    """Writes a new folder from texts by file path; it appears only when it is complete.

    Raises OSError.
    """
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


MASS, DAMPING, STIFFNESS = 2.0, 0.8, 15.0
"""kg, N·s/m, N/m."""
SAMPLE_TIME = 0.05
_ROWS = 200
_LARGEST_FORCE = 5.0
_POSITION_NOISE, _VELOCITY_NOISE = 1e-3, 5e-3
_TRAIN, _TEST = 8, 2
_FINE = 20
"""Integrator steps per sample: the integration error is far below the noise."""


def sample_records() -> dict[str, str]:
    """CSV texts by file name, always the same ones: time, force, noisy position and velocity."""
    # Philox by name: `default_rng` may become another generator, and the files would change
    random = np.random.Generator(np.random.Philox(2024))
    names = [f"train/run_{i + 1:02}.csv" for i in range(_TRAIN)]
    names += [f"test/run_{i + 1:02}.csv" for i in range(_TEST)]
    return {name: _record(random) for name in names}


def _record(random: np.random.Generator) -> str:
    force = _steps(random)
    position, velocity = _motion(force, random.uniform(-0.2, 0.2), random.uniform(-0.5, 0.5))
    position += random.normal(0.0, _POSITION_NOISE, _ROWS)
    velocity += random.normal(0.0, _VELOCITY_NOISE, _ROWS)
    rows = zip(np.arange(_ROWS) * SAMPLE_TIME, force, position, velocity, strict=True)
    lines = (f"{t:.2f},{F:.4f},{x:.5f},{v:.5f}" for t, F, x, v in rows)
    return "\n".join(["time,F,x,v", *lines, ""])


def _steps(random: np.random.Generator) -> NDArray[np.float64]:
    """A force that jumps to a new value every 0.3 s to 1.5 s."""
    force = np.empty(_ROWS)
    row = 0
    while row < _ROWS:
        length = int(random.integers(6, 31))
        force[row : row + length] = round(random.uniform(-_LARGEST_FORCE, _LARGEST_FORCE), 4)
        row += length
    return force


def _motion(
    force: NDArray[np.float64], x: float, v: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and velocity at every row; the force is constant between rows.

    Velocity Verlet (Swope et al. 1982) with small steps and implicit damping.
    """
    positions, velocities = np.empty(_ROWS), np.empty(_ROWS)
    h = SAMPLE_TIME / _FINE
    for row in range(_ROWS):
        positions[row], velocities[row] = x, v
        for _ in range(_FINE):
            pull = force[row] - STIFFNESS * x
            # v half a step later, by the force at its beginning
            half = v + 0.5 * h * (pull - DAMPING * v) / MASS
            x += h * half
            pull = force[row] - STIFFNESS * x
            # the other half by the force at its end, where damping depends on v itself: solved for
            # v
            v = (half + 0.5 * h * pull / MASS) / (1.0 + 0.5 * h * DAMPING / MASS)
    return positions, velocities
