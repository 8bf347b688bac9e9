"""Loads packages that take files of the working folder for their own while it is another one.

matplotlib reads a `matplotlibrc` that lies there. NVIDIA's libraries, which torch loads, look for
`libcuda.so.1` there before they look in the system, and run it.
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
    """Makes the folder of this module the working folder for as long as the block takes."""
    with contextlib.ExitStack() as stack:
        # where the working folder is gone, nothing is found in it either
        with contextlib.suppress(FileNotFoundError):
            stack.enter_context(contextlib.chdir(Path(__file__).parent))
        yield


def load_away_from_folder() -> None:
    """Lets this process load these packages so from now on."""
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


class _Finder:
    """Finds these packages as Python does; the working folder is another one as they are loaded."""

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """As `importlib.abc.MetaPathFinder.find_spec`; None for all other modules."""
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
