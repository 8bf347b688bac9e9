"""Builds the wheel that is looked into and installed."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """As `pip install` of the checkout makes it."""
    return built(ROOT, tmp_path_factory.mktemp("wheel"))


def built(checkout: Path, folder: Path) -> zipfile.ZipFile:
    """The wheel of a checkout, written to the folder."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel"]
    subprocess.run(
        [*command, "--directory", str(folder)], cwd=checkout, check=True, capture_output=True
    )
    (found,) = folder.glob("*.whl")
    return zipfile.ZipFile(found)
