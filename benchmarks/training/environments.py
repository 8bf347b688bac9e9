"""Makes a Python environment for each other tool, once, with pip."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

FOLDER = "MSNN_PEERS"
"""Names the environment variable with the folder; the user's cache folder without it."""

_LISTS = Path(__file__).parent / "peers"


def peer_python(name: str, lists: Path = _LISTS) -> Path:
    """The Python interpreter of a tool's environment; makes it from NAME.txt in `lists` if it is
    missing.
    """
    given = os.environ.get(FOLDER)
    folder = (Path(given) if given else Path.home() / ".cache" / "msnn" / "peers") / name
    python = folder / "bin" / "python"
    if not python.exists():
        print(f"making the environment of {name} in {folder}", file=sys.stderr)
        venv.create(folder, with_pip=True)
        subprocess.run(
            [python, "-m", "pip", "install", "--quiet", "-r", lists / f"{name}.txt"], check=True
        )
    return python
