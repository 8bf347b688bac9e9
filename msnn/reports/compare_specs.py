"""Compares two models entry by entry; detects changes of names or comments only."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

from compiler.ir.program import Program
from compiler.linking.link import MODEL_SECTIONS
from msnn.model.model import Model
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.settings import workflow

Kind = Literal["same", "text", "renamed", "workflow", "model"]

# Sections whose entries have names that expressions use.
_NAMED = ("dims", *MODEL_SECTIONS, "losses")
_DOC = "doc"


@dataclass(frozen=True)
class ChangedValue:
    """A value of the spec that differs; `old` or `new` is None if it does not exist."""

    path: str
    old: Any
    new: Any


@dataclass(frozen=True)
class SpecDifference:
    """The changes between two specs, and what kind of difference they are together.

    `same`: identical in all significant characters. `text`: comments, layout, docs, or another form
    of the same program. `renamed`: names differ only, see `renames`. `workflow`: only training,
    validation, export, control or estimation differ. `model`: the models differ.
    """

    kind: Kind
    changes: tuple[ChangedValue, ...] = ()
    renames: Mapping[str, str] | None = None

    @property
    def workflow(self) -> tuple[str, ...]:
        """The workflow sections that differ."""
        touched = {change.path.partition(".")[0] for change in self.changes if not _is_doc(change)}
        return tuple(section for section in workflow() if section in touched)

    @property
    def is_same(self) -> bool:
        """True if both specs have the same meaning."""
        return self.kind in ("same", "text")


def compare_specs(old: Model, new: Model) -> SpecDifference:
    """Compares two models; paths are those of the canonical spec."""
    before, after = spec_data(old.spec), spec_data(new.spec)
    changes = tuple(_changes("", before, after))
    # programs too: text that the canonical spec does not hold (a sub-model, weights) may have
    # changed
    if not changes and _meaning(old.program) == _meaning(new.program):
        return SpecDifference("same" if old.text == new.text else "text")
    renames = _renames(before, after)
    # one rule: what is left after renaming is nothing. Two entries exchanged or moved are no
    # renaming
    if renames and _renamed(before, renames) == after:
        return SpecDifference("renamed", changes, renames)
    if _meaning(old.program) == _meaning(new.program):
        # a changed model section with the same program is another way to write it
        found = SpecDifference("workflow", changes)
        return found if found.workflow else replace(found, kind="text")
    return SpecDifference("model", changes)


def _is_doc(change: ChangedValue) -> bool:
    return change.path.rpartition(".")[2] == _DOC


def _meaning(program: Program) -> Program:
    """The program without its hash, plug-ins and docs, which do not affect its values."""
    return replace(
        program,
        spec_hash="",
        plugins=(),
        doc="",
        signals=tuple(replace(signal, doc="") for signal in program.signals),
        parameters=tuple(replace(parameter, doc="") for parameter in program.parameters),
        states=tuple(replace(state, doc="") for state in program.states),
        outputs=tuple(replace(output, doc="") for output in program.outputs),
    )


def _changes(path: str, old: Any, new: Any) -> Iterator[ChangedValue]:
    before, after = _table(old), _table(new)
    earlier, later = _list_of_tables(old), _list_of_tables(new)
    if before is not None and after is not None:
        for key in dict.fromkeys((*before, *after)):
            inner = f"{path}.{key}" if path else key
            yield from _changes(inner, before.get(key), after.get(key))
    elif earlier and later:
        # by position, as stages and limits have no names that would tell them apart
        for index in range(max(len(earlier), len(later))):
            pair = [items[index] if index < len(items) else None for items in (earlier, later)]
            yield from _changes(f"{path}.{index}", *pair)
    elif old != new:
        yield ChangedValue(path, old, new)


def _table(value: Any) -> dict[str, Any] | None:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else None


def _list_of_tables(value: Any) -> list[Any]:
    items = cast("list[Any]", value) if isinstance(value, list) else []
    return items if any(isinstance(item, dict) for item in items) else []


def _renames(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, str]:
    """The renamed entries, matched by position; empty if the numbers of entries differ."""
    renames: dict[str, str] = {}
    if old.get("name") != new.get("name"):
        renames[old["name"]] = new["name"]
    for section in _NAMED:
        before, after = list(old.get(section, {})), list(new.get(section, {}))
        # without names in common only the place says what became of what, and one more entry moves
        # them all
        if len(before) != len(after):
            return {}
        renames |= {a: b for a, b in zip(before, after, strict=True) if a != b}
    return renames


# no word after a point: members such as `vehicle.W` keep their last part; Greek letters are names
# too
_WORD = re.compile(r"(?<![\w.])[A-Za-zͰ-Ͽ][A-Za-z0-9_Ͱ-Ͽ]*")


def _renamed(value: Any, renames: Mapping[str, str], *, unit: bool = False) -> Any:
    """The value with names replaced in keys and expressions; units are unchanged."""
    match value:
        case dict():
            table = cast("dict[str, Any]", value)
            return {
                renames.get(key, key): _renamed(item, renames, unit=key in ("unit", _DOC))
                for key, item in table.items()
            }
        case list():
            return [_renamed(item, renames) for item in cast("list[Any]", value)]
        case str() if not unit:
            return _WORD.sub(lambda found: renames.get(found[0], found[0]), value)
        case _:
            return value
