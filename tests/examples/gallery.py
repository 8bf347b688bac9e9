"""The gallery's specs, and a folder in which they lie beside their data."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

GALLERY = Path(__file__).resolve().parents[2] / "examples" / "gallery"
EXAMPLES = sorted(
    path
    for path in GALLERY.parent.glob("**/*.msnn.yaml")
    # what was trained there keeps specs of its own
    if "runs" not in path.relative_to(GALLERY.parent).parts
)
"""The specs of all examples."""
NAMES = sorted(path.name.removesuffix(".msnn.yaml") for path in GALLERY.glob("*.msnn.yaml"))


def gallery_copy(place: Path) -> Path:
    """Copies the specs to a folder and lets the generator write their data beside them."""
    for name in NAMES:
        shutil.copy(GALLERY / f"{name}.msnn.yaml", place)
    generator = [sys.executable, str(GALLERY / "generate_data.py"), "--out", str(place / "data")]
    subprocess.run(generator, check=True, capture_output=True)
    return place


def spec_of(folder: Path, name: str) -> Path:
    return folder / f"{name}.msnn.yaml"
