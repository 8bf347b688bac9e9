"""Every export says whose its text is, and names what others have written in it."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from msnn.exports.export import plan_exports, write_export
from msnn.exports.table import NAMES
from msnn.exports.target import Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {range: [-1, 1]}}
states: {x: {next: 0.9 * x + tanh(u), range: [-20, 20]}}
outputs: {y: x}
mpc:
  horizon: 4
  controls: [u]
  cost: x**2 + u**2
  bounds: {u: {min: -1, max: 1}}
"""
GRANT = (
    "What msnn wrote here is yours, without conditions: use, change and sell it, and name nobody."
)
SETTINGS = dict.fromkeys(NAMES, ()) | {
    "c in fixed point": ("export.c.dtype=q15",),
    "mpc with units": ("export.mpc.with=fmu",),
}


def exported(target: str, folder: Path) -> Written:
    spec = folder / "plant.msnn.yaml"
    spec.write_text(SPEC, encoding="utf-8")
    findings = Findings()
    model = load_model(spec, SETTINGS[target])
    (plan,) = plan_exports(model, [target.partition(" ")[0]], findings)
    return write_export(plan, initial_weights(plan.program), folder / "out")


@pytest.mark.parametrize("target", SETTINGS)
def test_an_export_is_the_users_without_conditions(target: str, tmp_path: Path) -> None:
    written = exported(target, tmp_path)
    (page,) = (path for path in written.files if path.suffix == ".md")
    text = page.read_text(encoding="utf-8")
    assert text.count(GRANT) == 1
    _, said, parts = text.partition("\nThird-party parts: ")
    assert said
    named = [word for word in parts.split("`")[1::2] if word.endswith("/")]
    for name, content in contents(written):
        if b"copyright" in content.lower():
            assert any(name.startswith(folder) for folder in named), f"{name} is somebody's"
    assert (not named) == parts.startswith("none")


def contents(written: Written) -> Iterator[tuple[str, bytes]]:
    """All files by their place, those in archives too but for binaries and licences."""
    for path in written.files:
        place = path.relative_to(written.folder).as_posix()
        if path.suffix != ".fmu":
            yield place, path.read_bytes()
            continue
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if not name.startswith(("binaries/", "documentation/")):
                    yield f"{place}/{name}", archive.read(name)
