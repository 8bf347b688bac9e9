"""What a test may need from the machine: absent, the test is skipped for a user and fails in CI."""

import importlib.util
import os
import shutil
from pathlib import Path
from typing import NoReturn

import pytest


def require_tool(name: str, install: str) -> str:
    """Returns the path of the command `name`; `install` is the line that installs it."""
    found = shutil.which(name)
    if found is None:
        miss(f"{name} is not installed: {install}")
    return found


def require_package(name: str, install: str) -> None:
    """Sees that the Python package `name` can be imported."""
    if importlib.util.find_spec(name) is None:
        miss(f"{name} is not installed: {install}")


def require_folder(path: str | Path) -> Path:
    """Returns the folder `path`, which holds data or drafts that the project does not carry."""
    folder = Path(path)
    if not folder.is_dir():
        miss(f"there is no folder {folder}")
    return folder


def miss(reason: str) -> NoReturn:
    if in_ci():
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def in_ci() -> bool:
    return os.environ.get("CI", "").lower() in {"1", "true"}
