"""Tells what the schema says of the value at a path: its entry, its leaf, its keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Gathering, LeafField
from spec_schema.reading.value_paths import Kind, entry_of, inside
from spec_schema.sections.spec import Spec


@dataclass(frozen=True)
class SchemaPlace:
    """A value of a spec: its type, what annotates that, and the key that it has in an entry."""

    kind: Kind
    notes: tuple[Any, ...] = ()
    owner: type[Entry] | None = None
    """The entry of which it is a key; None for names and items of lists."""
    key: str = ""

    @property
    def entry(self) -> type[Entry] | None:
        """The mapping that it is, if it is one with fixed keys."""
        return entry_of(self.kind)

    @property
    def gathering(self) -> Gathering | None:
        """The reader of its keys or items, where the user chooses them."""
        return next((note for note in self.notes if isinstance(note, Gathering)), None)

    @property
    def leaf(self) -> LeafField | None:
        """The reader of one value, of a shorthand too, and of an item where one may stand."""
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
        """Whether its keys are names that the user chooses."""
        is_union = get_origin(self.kind) in (Union, UnionType)
        origins = (get_origin(arm) for arm in (get_args(self.kind) if is_union else (self.kind,)))
        return any(isinstance(origin, type) and issubclass(origin, Mapping) for origin in origins)

    @property
    def words(self) -> tuple[str, ...]:
        """The words that it may be, where it is one of some."""
        if self.leaf is None:
            return ()
        schema = self.leaf.schema
        is_switch = schema.get("type") == "boolean"
        return ("true", "false") if is_switch else tuple(map(str, schema.get("enum", ())))

    def below(self, step: str) -> SchemaPlace:
        """The value of a key, a name or an item in it."""
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
    """The value at a path of keys, names and numbers of items; None where nobody knows it."""
    place = SchemaPlace(Spec)
    for step in path:
        place = place.below(step)
        if place.kind is None:
            return None
    return place


def _notes(kind: Kind) -> Iterator[Any]:
    """The annotations of a type, or of an arm of a union."""
    origin = get_origin(kind)
    if origin is Annotated:
        inner, *notes = get_args(kind)
        yield from notes
        yield from _notes(inner)
    elif origin in (Union, UnionType):
        for arm in get_args(kind):
            yield from _notes(arm)


def _items(kind: Kind) -> Kind | None:
    """The type of the items of a list; None for all else."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _items(get_args(kind)[0])
    if origin in (Union, UnionType):
        return next((found for arm in get_args(kind) if (found := _items(arm)) is not None), None)
    return get_args(kind)[0] if origin is tuple else None
