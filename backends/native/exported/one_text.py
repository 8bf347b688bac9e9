"""Joins the files of generated C to a single source for the kernel cache."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePosixPath


def one_text(texts: Mapping[str, str]) -> str:
    """Concatenates headers and sources, without the `#include` lines between them."""
    names = {PurePosixPath(path).name for path in texts}
    paths = [path for path in texts if path.startswith(("include/", "src/"))]
    ordered = sorted(paths, key=lambda path: (not path.startswith("include/"), path[-2:] != ".h"))
    own = re.compile(r'^#include "([^"]+)"$', re.MULTILINE)
    return "\n".join(
        own.sub(lambda found: "" if found[1] in names else found[0], texts[path])
        for path in ordered
    )
