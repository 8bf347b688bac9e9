"""Every place of every text is answered without a failure, half-typed texts too."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from msnn.features.language_server.completion import complete
from msnn.features.language_server.cursor import ITEM
from msnn.features.language_server.definition import definition
from msnn.features.language_server.hover import hover
from msnn.features.language_server.knowledge import Knowledge, examine
from msnn.features.language_server.positions import offset_of, position_of
from msnn.features.language_server.schema_place import place_of
from msnn.features.language_server.view import View
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree
from tests.features.language_server.test_diagnostics import SPECS, text_of

ROOT = Path(__file__).parents[3]
GOOD = sorted((ROOT / "tests" / "spec_schema" / "good").glob("*.*"))
GALLERY = sorted((ROOT / "examples" / "gallery").glob("*.msnn.yaml"))
_PLACES = 12


def _answered(view: View, chance: random.Random) -> None:
    assert len(view.outline) <= view.source.line_count
    for _ in range(_PLACES):
        line, column = view.source.position(chance.randrange(len(view.source.text) + 1))
        position = position_of(line - 1, column - 1, view.source)
        assert offset_of(position, view.source) == (line - 1, column - 1)
        for answer in (hover, complete, definition):
            answer(view, position)


def test_every_broken_spec_is_answered():
    chance = random.Random(1)
    for path in SPECS:
        text = text_of(path)
        if text is not None:
            # columns of a line end are those of the line's end
            source = SourceText(str(path), text.replace("\r", ""))
            _answered(View(source, Knowledge()), chance)


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.parent.name)
def test_every_example_is_answered_while_it_is_typed(path: Path):
    text, chance = path.read_text(encoding="utf-8"), random.Random(2)
    knowledge = examine(str(path), text, {}).knowledge
    assert knowledge is not None
    _answered(View(SourceText(str(path), text), knowledge), chance)
    for _ in range(8):
        cut = chance.randrange(len(text))
        end = chance.randrange(cut, len(text))
        half = View(SourceText(str(path), text[:cut] + text[end:]), knowledge)
        _answered(half, chance)


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.parent.name)
def test_every_name_of_an_example_has_hover_and_definition(path: Path):
    text = path.read_text(encoding="utf-8")
    knowledge = examine(str(path), text, {}).knowledge
    assert knowledge is not None
    view = View(SourceText(str(path), text), knowledge)
    for name, known in knowledge.names.items():
        if known.place.file != str(path) or "." in name:
            continue
        place = position_of(known.place.line - 1, known.place.column - 1, view.source)
        said, found = hover(view, place), definition(view, place)
        assert said is not None, name
        assert said.text.startswith(f"**{name}**, {known.kind.value}"), said.text
        assert found is not None, name
        assert (found.path, found.range.start) == (str(path), place), name


@pytest.mark.parametrize("path", [*GALLERY, *GOOD], ids=lambda path: path.stem)
def test_every_key_of_an_example_is_proposed_and_explained(path: Path):
    source = SourceText(str(path), path.read_text(encoding="utf-8"))
    root = read_tree(source, Findings())
    assert root is not None
    view = View(source, Knowledge())
    checked = 0
    for steps, key, place in _keys((), root):
        found = place_of(steps)
        if found is None or found.entry is None or key not in found.entry.known_keys():
            continue
        checked += 1
        after = position_of(place.line - 1, place.column, view.source)
        proposed = complete(view, after)
        assert proposed is not None, (steps, key)
        assert key in [item.label for item in proposed.items], (steps, key)
        said = hover(view, after)
        assert said is not None, (steps, key)
        assert said.text.startswith(f"**{key}** of {found.entry.noun}"), (steps, key, said.text)
    assert checked > 4


def _keys(steps: tuple[str, ...], node: Node) -> Iterator[tuple[tuple[str, ...], str, Span]]:
    """Every key of a tree with the path to the mapping that it is in."""
    match node:
        case Table(entries=entries, keys=keys):
            for key, value in entries.items():
                yield steps, key, keys[key]
                yield from _keys((*steps, key), value)
        case Listing(items=items):
            for item in items:
                yield from _keys((*steps, ITEM), item)
        case Scalar():
            pass
