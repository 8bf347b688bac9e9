"""What tests of pages share."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest

from tests.docs.command_server import commands


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """A folder with a command `msnn` that has nothing to import."""
    with commands(tmp_path_factory.mktemp("commands")) as folder:
        yield folder
