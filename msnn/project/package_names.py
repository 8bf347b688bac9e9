"""Checks that the generic package names of a checkout refer to the folders next to `msnn`.

A user's `compiler.py` in the working folder would be imported instead of the compiler, and fail far
from the cause. In a wheel, the packages are below `msnn.` (decision 0258), where no conflict is
possible.
"""

import importlib.util
from pathlib import Path

HOME = Path(__file__).resolve().parents[2]
COMPANIONS = ("spec_schema", "compiler", "backends", "templates")


def check_package_names() -> None:
    """Raises ImportError unless each companion package is the folder of that name next to `msnn`.

    The names are only located, not imported.
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
