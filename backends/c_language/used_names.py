"""Finds the variables that C statements use."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, cast

from backends.c_language.tree import Name, Statement


def used_names(statements: Iterable[Statement]) -> frozenset[str]:
    """The names of all variables in expressions of the statements."""
    found = set[str]()
    waiting: list[Any] = [*statements]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Name):
            found.add(part.text)
        elif isinstance(part, tuple):
            waiting.extend(cast("tuple[Any, ...]", part))
        elif dataclasses.is_dataclass(part):
            waiting.extend(getattr(part, field.name) for field in dataclasses.fields(part))
    return frozenset(found)
