"""A proxy for `importlib.metadata` that imports it on first use.

pydantic imports it to search for plugins, even if plugins are disabled. With its own imports, such
as `email` and `zipfile`, that took a twentieth of `check`.
"""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec
from types import ModuleType
from typing import Any

_NAME = "importlib.metadata"


def load_metadata_when_asked() -> None:
    """Makes the import of `importlib.metadata` free; its contents are loaded on first use."""
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
    """Provides `entry_points` as a lazy function, because pydantic takes a reference to it
    early.
    """

    def entry_points(self, **wanted: str) -> Any:
        """See `importlib.metadata.entry_points`."""
        return self._loaded().entry_points(**wanted)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loaded(), name)

    def _loaded(self) -> ModuleType:
        """The real module, which replaces the proxy."""
        if sys.modules.get(_NAME) is self:
            del sys.modules[_NAME]
        return importlib.import_module(_NAME)
