"""Compares the export sections of two specs: what must callers of the exports change?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from msnn.exports.export import target_named
from msnn.exports.table import every_target
from msnn.features.changes.interface_changes import InterfaceChange
from msnn.model.model import Model
from spec_schema.fields.leaf import Located
from spec_schema.sections.exports import TargetEntry

_BREAKS = {
    "dtype": "numbers have another type",
    "prefix": "functions, types and files have other names",
    "params": "parameters are given in another way",
    "delay": "outputs belong to another sample",
    "close": "other inputs are to be given",
}
"""Keys of targets whose changes affect callers, with the reason."""


def export_changes(old: Model, new: Model) -> tuple[InterfaceChange, ...]:
    """The differences of targets in both specs, in the order of the section."""
    return tuple(_changes(old, new))


def _changes(old: Model, new: Model) -> Iterator[InterfaceChange]:
    for target in (each.name for each in every_target()):
        before, after = _entry(old, target), _entry(new, target)
        if before is None or after is None:
            continue
        for key, breaks in _BREAKS.items():
            one, other = getattr(before, key, None), getattr(after, key, None)
            if one == other:  # no target has to be loaded for its default
                continue
            left, right = _text(one, target, key), _text(other, target, key)
            if left != right:
                yield InterfaceChange(
                    part=f"export {target}",
                    what=key,
                    old=left,
                    new=right,
                    breaks=breaks,
                    span=after.place.key,
                )


def _entry(model: Model, target: str) -> TargetEntry | None:
    section = model.spec.export
    return None if section is None else getattr(section, target)


def _text(value: object, target: str, key: str) -> str:
    """The value of a key, or its default; the order of names is ignored."""
    match value:
        case None if key == "dtype":
            return target_named(target).dtype
        case None:
            return ""  # a prefix: the name of the model, which is compared by itself
        case tuple():
            names = cast("tuple[Located[str], ...]", value)
            return ", ".join(sorted(each.value for each in names))
        case Located():
            return str(cast("Located[object]", value).value)
        case _:
            return str(value)
