"""Imports packages outside the working folder, because they would load files from it.

matplotlib reads a `matplotlibrc` in the working folder. NVIDIA's libraries, which torch loads, look
for `libcuda.so.1` there first, and run it.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Generator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

_PACKAGES = frozenset({"torch", "matplotlib"})


@contextlib.contextmanager
def away_from_folder() -> Generator[None]:
    """Changes the working folder to that of this module within the block."""
    with contextlib.ExitStack() as stack:
        # where the working folder is gone, nothing is found in it either
        with contextlib.suppress(FileNotFoundError):
            stack.enter_context(contextlib.chdir(Path(__file__).parent))
        yield


def load_away_from_folder() -> None:
    """Activates this import behaviour for the process."""
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


class _Finder:
    """A finder that imports these packages normally, but with another working folder."""

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
