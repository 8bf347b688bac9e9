"""A stand-in for `importlib.metadata` that loads it when somebody asks for something of it.

pydantic imports it to look for plugins, also where it is told to look for none. With what it reads
in turn, `email` and `zipfile` among others, that took a twentieth of `check`.
"""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec
from types import ModuleType
from typing import Any

_NAME = "importlib.metadata"


def load_metadata_when_asked() -> None:
    """Lets `importlib.metadata` be imported at no cost; whatever it is asked for, it answers."""
    if _NAME not in sys.modules:
        stand_in = _StandIn(_NAME)
        found = find_spec(_NAME)
        assert found is not None, "a part of Python"
        # `from … import` reads it, to see whether what it takes is a module too
        stand_in.__path__ = found.submodule_search_locations or []
        sys.modules[_NAME] = stand_in
        # where `import importlib.metadata` finds it
        setattr(importlib, "metadata", stand_in)  # noqa: B010  (no attribute that pyright knows)


class _StandIn(ModuleType):
    """Gives `entry_points` as a function that waits, because it is taken when pydantic starts."""

    def entry_points(self, **wanted: str) -> Any:
        """As `importlib.metadata.entry_points`."""
        return self._loaded().entry_points(**wanted)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loaded(), name)

    def _loaded(self) -> ModuleType:
        """The module itself, in this one's place from now on."""
        if sys.modules.get(_NAME) is self:
            del sys.modules[_NAME]
        return importlib.import_module(_NAME)
