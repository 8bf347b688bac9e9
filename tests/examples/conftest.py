"""The fixture `example`, for tests of an example whose programs are modules of its folder."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture
def example(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Imports a module of the folder EXAMPLE of the test's file, and forgets all in the end."""
    folder = request.module.EXAMPLE
    monkeypatch.syspath_prepend(str(folder))
    yield importlib.import_module
    for path in folder.glob("*.py"):
        sys.modules.pop(path.stem, None)
