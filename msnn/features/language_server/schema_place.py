"""Looks up the schema at a path: its entry, its leaf, its keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Gathering, LeafField
from spec_schema.reading.settings import Kind, entry_of, inside
from spec_schema.sections.spec import Spec


@dataclass(frozen=True)
class SchemaPlace:
    """The schema at a place of a spec: the type of its value, the annotations of that type, and its
    key.
    """

    kind: Kind
    notes: tuple[Any, ...] = ()
    owner: type[Entry] | None = None
    """The entry that contains the key; None for names and items of lists."""
    key: str = ""

    @property
    def entry(self) -> type[Entry] | None:
        """The class of the mapping here, if it has fixed keys; None otherwise."""
        return entry_of(self.kind)

    @property
    def gathering(self) -> Gathering | None:
        """The reader of user-defined keys, or of items of a list; None if the value is neither."""
        return next((note for note in self.notes if isinstance(note, Gathering)), None)

    @property
    def leaf(self) -> LeafField | None:
        """The reader of a scalar value, also of a shorthand such as `y: expr` or of an item given
        without its list; None if no scalar is allowed.
        """
        leaf = next((note for note in self.notes if isinstance(note, LeafField)), None)
        if leaf is not None:
            return leaf
        # `y: expr` for `y: {expr: …}`: the value may be that of the shorthand's key
        if self.entry is not None and self.entry.shorthand is not None:
            return self.below(self.entry.shorthand).leaf
        # one item may stand for a list of one
        items = _items(self.kind)
        return None if items is None else SchemaPlace(items, tuple(_notes(items))).leaf

    @property
    def is_mapping(self) -> bool:
        """True if its keys are names chosen by the user."""
        is_union = get_origin(self.kind) in (Union, UnionType)
        origins = (get_origin(arm) for arm in (get_args(self.kind) if is_union else (self.kind,)))
        return any(isinstance(origin, type) and issubclass(origin, Mapping) for origin in origins)

    @property
    def words(self) -> tuple[str, ...]:
        """The permitted words, if the value is a choice or a switch; empty otherwise."""
        if self.leaf is None:
            return ()
        schema = self.leaf.schema
        is_switch = schema.get("type") == "boolean"
        return ("true", "false") if is_switch else tuple(map(str, schema.get("enum", ())))

    def below(self, step: str) -> SchemaPlace:
        """The schema below a key, a name or the index of an item; its `kind` is None if there is
        none.
        """
        # the same walk as that of `--set`, so that editors and command line agree on what is a key
        kind = inside(self.kind, step)
        entry = self.entry
        if entry is not None:
            for name, field in entry.model_fields.items():
                if (field.alias or name) == step:
                    notes = (*field.metadata, *_notes(field.annotation))
                    return SchemaPlace(kind, notes, entry, step)
        return SchemaPlace(kind, tuple(_notes(kind)))


def place_of(path: Sequence[str]) -> SchemaPlace | None:
    """The schema at a path of keys, names and items from the top of a spec; None if the schema has
    no such place.
    """
    place = SchemaPlace(Spec)
    for step in path:
        place = place.below(step)
        if place.kind is None:
            return None
    return place


def _notes(kind: Kind) -> Iterator[Any]:
    """The annotations in `Annotated[T, …]` of a type, or of each member of a union, outermost
    first.
    """
    origin = get_origin(kind)
    if origin is Annotated:
        inner, *notes = get_args(kind)
        yield from notes
        yield from _notes(inner)
    elif origin in (Union, UnionType):
        for arm in get_args(kind):
            yield from _notes(arm)


def _items(kind: Kind) -> Kind | None:
    """The type of a list's items; None for other types."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _items(get_args(kind)[0])
    if origin in (Union, UnionType):
        return next((found for arm in get_args(kind) if (found := _items(arm)) is not None), None)
    return get_args(kind)[0] if origin is tuple else None
