"""A random spec: sections of entries whose expressions are trees, and their text."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
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
        # from the end: what is computed names what is declared, which then goes with it
        sections = {name: self.sections[name] for name in reversed(list(self.sections))}
        # a fault that stands in one of the files needs no other
        for part in self.parts.values():
            yield replace(part, sections={**part.sections, "name": self.sections["name"]})
        for less in chain(
            _without_a_part(sections),
            _entries_left_out(sections),
            _with_plain_terms(sections),
            _inlined(sections),
        ):
            yield self._with(less)
        for name, part in self.parts.items():
            for less in part.smaller():
                yield replace(self, parts={**self.parts, name: less})
        for less in _smaller(sections, ()):
            yield self._with(less)

    def without_unnamed(self) -> RandomSpec:
        """Without all that nobody names; itself where there is no such thing.

        Each change that keeps a fault costs the treatment of a spec, so that few large ones are
        quick.
        """
        left = dict(self.sections)
        while left != (fewer := _named(left)):
            left = fewer
        return self if left == self.sections else self._with(left)

    def _with(self, sections: Mapping[str, Section]) -> RandomSpec:
        ordered = {name: sections[name] for name in ORDER if name in sections}
        used = str(sections.get("use", ""))
        return RandomSpec(ordered, {n: part for n, part in self.parts.items() if n in used})


_NAME = "spec.msnn.yaml"
_SHOWN = ("states", "outputs", "losses", "train", "connect", "integrator")
"""Sections whose entries need nobody who names them."""


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


def _without_a_part(sections: Mapping[str, Section]) -> Iterator[Mapping[str, Section]]:
    """With a number in place of all that is read of a part."""
    for part in sections.get("use", {}):
        used = {name: entry for name, entry in sections["use"].items() if name != part}
        fed = sections.get("connect", {})
        fed = {name: term for name, term in fed.items() if not name.startswith(f"{part}.")}
        less = {name: entries for name, entries in sections.items() if name != "connect"}
        kept = {"use": used, **({"connect": fed} if fed else {})}
        left = {name: entry for name, entry in {**less, **kept}.items() if entry != {}}
        yield _replaced(left, re.compile(rf"\b{part}\.\w+"), Term("0.3"))


def _entries_left_out(sections: Mapping[str, Section]) -> Iterator[Mapping[str, Section]]:
    for name, entries in sections.items():
        if isinstance(entries, dict):
            for key in entries:
                yield {**sections, name: {n: each for n, each in entries.items() if n != key}}
        elif isinstance(entries, list):
            for i in range(len(entries)):
                yield {**sections, name: [*entries[:i], *entries[i + 1 :]]}


def _with_plain_terms(sections: Mapping[str, Section]) -> Iterator[Mapping[str, Section]]:
    """With a number or a signal in place of all that an entry computes."""
    for name, entries in sections.items():
        for key, entry in entries.items() if isinstance(entries, dict) else ():
            for plain in (Term("0.3"), Term("u")):
                if isinstance(entry, Term) and entry.operands:
                    yield {**sections, name: {**entries, key: plain}}
                elif isinstance(entry, dict):
                    terms = {n: plain for n, e in entry.items() if isinstance(e, Term)}
                    if terms:
                        yield {**sections, name: {**entries, key: {**entry, **terms}}}


def _inlined(sections: Mapping[str, Section]) -> Iterator[Mapping[str, Section]]:
    """With what an equation says in place of its name."""
    for name, entry in sections.get("equations", {}).items():
        said = entry.get("expr") if isinstance(entry, dict) else entry
        if isinstance(said, Term):
            left = {key: each for key, each in sections["equations"].items() if key != name}
            yield _replaced({**sections, "equations": left}, re.compile(re.escape(name)), said)


def _replaced(value: Any, name: re.Pattern[str], term: Term) -> Any:
    if isinstance(value, Term):
        return value.with_in_place_of(name, term)
    if isinstance(value, dict):
        return {key: _replaced(entry, name, term) for key, entry in value.items()}
    if isinstance(value, list):
        return [_replaced(entry, name, term) for entry in value]
    return value


def _smaller(value: Any, path: tuple[str, ...]) -> Iterator[Any]:
    """Values with less in them: entries left out, then entries that are smaller themselves."""
    if isinstance(value, Term):
        yield from value.smaller()
    elif isinstance(value, dict):
        half = len(value) // 2
        if half > 1 and path:
            yield dict(list(value.items())[:half])
            yield dict(list(value.items())[half:])
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
