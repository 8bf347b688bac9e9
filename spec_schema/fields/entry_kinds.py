"""Lists the kinds of mappings in a spec, and their nesting."""

import inspect
from collections.abc import Iterator
from inspect import isclass
from typing import Any, get_args

from spec_schema.fields.entry import Entry
from spec_schema.fields.late_entry import LateEntry


def kinds_within(first: type[Entry]) -> Iterator[type[Entry]]:
    """The kind itself and all nested kinds, outer ones first."""
    known, waiting = {first}, [first]
    while waiting:
        entry = waiting.pop(0)
        yield entry
        fields = entry.model_fields.values()
        found = [kind for field in fields for kind in kinds_of(field.annotation)]
        inner = [kind for kind in dict.fromkeys(found) if kind not in known]
        known.update(inner)
        # depth first, in the order of the fields
        waiting = [*inner, *waiting]


def kinds_of(annotation: Any) -> list[type[Entry]]:
    """The kinds of mappings that a field of this type holds."""
    if isclass(annotation) and issubclass(annotation, Entry):
        return [annotation]
    if isinstance(annotation, LateEntry):
        return [annotation.kind]
    return [kind for part in get_args(annotation) for kind in kinds_of(part)]


def about(kind: type[Entry]) -> str:
    """Describes a kind of mapping in a sentence or two."""
    return " ".join((inspect.getdoc(kind) or "").partition("\n\n")[0].split())
