"""A random spec: sections of entries whose expressions are trees, and their text."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from tests.random_specs.terms import Term

ORDER = (
    *("msnn", "name", "sample_time", "dims", "use", "inputs", "targets", "constants"),
    *("parameters", "layers", "functions", "states", "integrator", "equations", "connect"),
    *("outputs", "losses", "train", "export"),
)
FIXED = ("msnn", "name")

Section = Any
"""A mapping of names, a list, or a single value; terms stand where expressions do."""


@dataclass(frozen=True, slots=True)
class RandomSpec:
    """Sections by name, and the specs that are parts of this one by the names of their files."""

    sections: Mapping[str, Section]
    parts: Mapping[str, RandomSpec] = field(default_factory=dict)

    def texts(self) -> dict[str, str]:
        """The text of every file; this spec is `spec.msnn.yaml`."""
        texts = {name: part.texts()[_NAME] for name, part in self.parts.items()}
        return {_NAME: _text(self.sections), **texts}

    @property
    def size(self) -> int:
        """Characters of all texts."""
        return sum(map(len, self.texts().values()))

    def smaller(self) -> Iterator[RandomSpec]:
        """Specs with less in them, those with much less first; few of them are right."""
        for sections in (*_without_unnamed(self.sections), *_smaller(self.sections, ())):
            used = str(sections.get("use", ""))
            parts = {name: part for name, part in self.parts.items() if name in used}
            yield RandomSpec(sections, parts)
        for name, part in self.parts.items():
            for less in part.smaller():
                yield replace(self, parts={**self.parts, name: less})


_NAME = "spec.msnn.yaml"
_SHOWN = ("states", "outputs", "losses", "train", "connect", "integrator")
"""Sections whose entries need nobody who names them."""


def _without_unnamed(sections: Mapping[str, Section]) -> Iterator[Mapping[str, Section]]:
    """One step for all that is left over where what named it was left out.

    Each step that keeps the fault costs the exports of a spec, so that few large ones are quick.
    """
    left = dict(sections)
    while left != (fewer := _named(left)):
        left = fewer
    if left != sections:
        yield left


def _named(sections: Mapping[str, Section]) -> dict[str, Section]:
    """Entries that some text elsewhere names, and the sections that have any."""
    kept = dict(sections)
    for section, entries in sections.items():
        if isinstance(entries, dict) and section not in _SHOWN:
            kept[section] = {n: e for n, e in entries.items() if _is_named(n, section, kept)}
    return {section: entries for section, entries in kept.items() if entries != {}}


def _is_named(name: str, section: str, sections: Mapping[str, Section]) -> bool:
    entries = {key: entry for key, entry in sections[section].items() if key != name}
    return re.search(rf"\b{name}\b", _text({**sections, section: entries})) is not None


def _text(sections: Mapping[str, Section]) -> str:
    lines: list[str] = []
    for name in ORDER:
        if name not in sections:
            continue
        value = sections[name]
        if isinstance(value, dict) and value and name != "integrator":
            lines.append(f"{name}:")
            lines += [f"  {key}: {_json(entry)}" for key, entry in value.items()]
        elif isinstance(value, list):
            lines.append(f"{name}:")
            lines += [f"  - {_json(entry)}" for entry in value]
        else:
            lines.append(f"{name}: {_json(value)}")
    return "\n".join(lines) + "\n"


def _json(value: Any) -> str:
    return json.dumps(value, default=str)


def _smaller(value: Any, path: tuple[str, ...]) -> Iterator[Any]:
    """Values with less in them: entries left out, then entries that are smaller themselves."""
    if isinstance(value, Term):
        yield from value.smaller()
    elif isinstance(value, dict):
        for key in value:
            if path or key not in FIXED:
                yield {name: entry for name, entry in value.items() if name != key}
        for key, entry in value.items():
            for less in _smaller(entry, (*path, key)):
                yield {**value, key: less}
    elif isinstance(value, list):
        for number in range(len(value)):
            yield [*value[:number], *value[number + 1 :]]
        for number, entry in enumerate(value):
            for less in _smaller(entry, (*path, str(number))):
                yield [*value[:number], less, *value[number + 1 :]]
