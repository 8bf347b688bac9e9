"""Checks that a checkout's generic package names mean the folders beside `msnn`, not a stranger's.

A user's own `compiler.py` in the working folder would be imported in place of the compiler, and
fail far away from the cause. Installed from a wheel, the packages lie below `msnn.` (decision
0258), and nobody's names are in the way.
"""

import importlib.util
from pathlib import Path

HOME = Path(__file__).resolve().parents[2]
COMPANIONS = ("spec_schema", "compiler", "backends", "templates")


def check_package_names() -> None:
    """Raises ImportError unless each companion package is the folder of that name beside `msnn`.

    Only looks the names up; it imports none of them.
    """
    # a wheel: the companions are below `msnn`
    if all((HOME / "msnn" / name).is_dir() for name in COMPANIONS):
        return
    for name in COMPANIONS:
        found = place_of(name)
        if found is None:
            raise ImportError(f"msnn is installed incompletely: its package `{name}` is missing.")
        if found != HOME / name:
            raise ImportError(
                f"msnn needs the name `{name}` for its package, but Python finds {found} first: "
                "rename that one or run msnn from another folder."
            )


def place_of(name: str) -> Path | None:
    """The folder of package `name`, or the file of a plain module; None if there is neither."""
    spec = importlib.util.find_spec(name)
    if spec is None:
        return None
    if spec.submodule_search_locations is not None:
        folders = [Path(folder).resolve() for folder in spec.submodule_search_locations]
        return folders[0] if folders else None
    return Path(spec.origin).resolve() if spec.origin else None
