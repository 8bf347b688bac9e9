"""Compiles and loads exported controllers without an optimiser, which takes most of the time.

Their bits are those of every level (`test_controllers.py`).
"""

from __future__ import annotations

from pathlib import Path

from backends.c.host.build import build_library
from msnn.features.control.backend.library import ControllerLibrary


def built_controller(folder: Path) -> ControllerLibrary:
    library = build_library(folder, folder / "controller.so", flags=("-O0",))
    return ControllerLibrary.of_folder(folder, library)
