"""Finds what the schema says of the value at a path: the entry it is, and what stands in it."""

from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from spec_schema.fields.entry import Entry
from spec_schema.fields.late_entry import LateEntry
from spec_schema.fields.leaf import Gathering, declarations, members

Kind = Any
"""The type of a field, as pydantic has it: an entry, a mapping or tuple of some, or a leaf."""


def entry_of(kind: Kind) -> type[Entry] | None:
    """The entry that a value of this type is; None for leaves, lists and mappings of names."""
    arms = (arm for arm in _arms(kind) if isinstance(arm, type) and issubclass(arm, Entry))
    return next(arms, None)


def inside(kind: Kind, step: str) -> Kind:
    """The type of what a key, a name or the number of an item leads to; None where nobody knows."""
    for arm in _arms(kind):
        if isinstance(arm, type) and issubclass(arm, Entry):
            for name, field in arm.model_fields.items():
                # as the user writes it: `from`, `validate`
                if step == (field.alias or name):
                    return field.annotation
            continue
        origin = get_origin(arm)
        # tuples of a spec are homogeneous, `tuple[X, ...]`
        if origin is tuple:
            return get_args(arm)[0]
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return get_args(arm)[1]
    return None


def named_sections(spec: type[Entry]) -> tuple[str, ...]:
    """The sections whose keys are names that the spec declares or connects."""
    return tuple(
        field.alias or name
        for name, field in spec.model_fields.items()
        if any(
            isinstance(m, Gathering) and m.schema in (declarations, members) for m in field.metadata
        )
    )


def _arms(kind: Kind) -> Iterator[Any]:
    """A type without what annotates it; of a union each."""
    if get_origin(kind) is Annotated:
        inner, *notes = get_args(kind)
        late = [note.kind for note in notes if isinstance(note, LateEntry)]
        yield from late or _arms(inner)
    elif get_origin(kind) in (Union, UnionType):
        for arm in get_args(kind):
            yield from _arms(arm)
    else:
        yield kind
