"""Imports packages outside the working folder, and `importlib.metadata` on first use."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Generator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

_PACKAGES = frozenset({"torch", "matplotlib"})


@contextlib.contextmanager
def away_from_folder() -> Generator[None]:
    """A context in which the working folder is the folder of this module."""
    with contextlib.ExitStack() as stack:
        # where the working folder is gone, nothing is found in it either
        with contextlib.suppress(FileNotFoundError):
            stack.enter_context(contextlib.chdir(Path(__file__).parent))
        yield


def load_away_from_folder() -> None:
    """Makes later imports of certain packages ignore modules in the working folder."""
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


class _Finder:
    """An import finder that looks for certain packages with another working folder."""

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See `importlib.abc.MetaPathFinder.find_spec`; None for all other modules."""
        if name not in _PACKAGES:
            return None
        found = PathFinder.find_spec(name, path, target)
        loader = None if found is None else found.loader
        if loader is not None:
            load = loader.exec_module

            def load_away(module: ModuleType) -> None:
                with away_from_folder():
                    load(module)

            # of this loader alone, which no other module has
            loader.exec_module = load_away
        return found


_NAME = "importlib.metadata"


def load_metadata_when_asked() -> None:
    """Delays loading `importlib.metadata` until it is used, because its import is slow."""
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
