"""`diff` says of every key that the language has whether the model, or what it is for, differs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

import msnn
from compiler.linking.link import MODEL_SECTIONS
from msnn.reports import compare_specs as compared
from msnn.reports.compare_specs import compare_specs
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import read_one_spec
from spec_schema.reading.settings import workflow
from spec_schema.sections.spec import Spec

ROOT = Path(__file__).resolve().parents[3]
COMPLETE = spec_data(read_one_spec(ROOT / "tests/spec_schema/good/complete.yaml").spec)
GALLERY = sorted((ROOT / "examples/gallery").glob("*.msnn.yaml"))
_REST = {"msnn", "name", "doc", "sample_time", "dims", "use", "integrator", "connect", "losses"}

Place = tuple[str | int, ...]


def leaves(value: Any, path: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every value of data that is no table and no list, with its place."""
    match value:
        case dict():
            for key, inner in cast("dict[str, Any]", value).items():
                yield from leaves(inner, (*path, key))
        case list():
            for index, inner in enumerate(cast("list[Any]", value)):
                yield from leaves(inner, (*path, index))
        case _:
            yield path, value


def changed(value: Any, path: Place, new: Any) -> Any:
    """A copy of data with another value in one place."""
    if not path:
        return new
    first, *rest = path
    copy = value.copy()
    copy[first] = changed(value[first], tuple(rest), new)
    return copy


def test_every_section_is_model_or_workflow() -> None:
    sections = {info.alias or name for name, info in Spec.model_fields.items() if name != "place"}
    assert {*MODEL_SECTIONS, *workflow(), *_REST} >= sections
    assert not {*MODEL_SECTIONS, *_REST} & {*workflow()}


@pytest.mark.parametrize("section", COMPLETE)
def test_no_key_of_a_section_changes_unsaid(section: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the program says the same, the sections of the workflow decide."""
    model = msnn.load(GALLERY[0])
    for path, value in leaves(COMPLETE[section], (section,)):
        both = iter((COMPLETE, changed(COMPLETE, path, f"other than {value}")))
        monkeypatch.setattr(compared, "spec_data", lambda spec, both=both: next(both))
        found = compare_specs(model, model)
        assert found.changes, path
        is_workflow = section in workflow() and path[-1] != "doc"
        if section == "name":
            assert found.kind == "renamed"
            continue
        assert found.kind == ("workflow" if is_workflow else "text"), path
        assert found.workflow == ((section,) if is_workflow else ()), path


def candidates(value: Any) -> Iterator[Any]:
    """Other values that may stand in the place of one, the likeliest first."""
    match value:
        case bool():
            yield not value
        case int() | float():
            yield from (value + 1, value * 1.5, value / 2, value + 0.1, value - 0.1, value + 0.001)
        case str() if found := re.search(r"\d+(\.\d+)?", value):
            for number in (float(found[0]) * 2, float(found[0]) / 2, float(found[0]) + 1, 0.01):
                yield f"{value[: found.start()]}{number:g}{value[found.end() :]}"
        case _:
            return


def cases() -> Iterator[Any]:
    """One place of each key in sections of the model that the gallery has."""
    seen: set[tuple[str, ...]] = set()
    for file in GALLERY:
        data = spec_data(read_one_spec(file).spec)
        for path, value in leaves(data):
            section = str(path[0])
            # the name of an entry is the user's
            key = (section, *(str(part) for part in path[2:] if isinstance(part, str)))
            # a unit that does not fit is warned of, and the program keeps that of the formula;
            # without `mix` an equation learner has other arguments
            if (
                section in (*workflow(), "msnn")
                or path[-1] in ("doc", "unit", "mix")
                or key in seen
                or not any(True for _ in candidates(value))
            ):
                continue
            seen.add(key)
            yield pytest.param(file, path, value, id=".".join(map(str, path)))


@pytest.mark.parametrize(("file", "path", "value"), list(cases()))
def test_another_value_in_the_model_is_another_model(file: Path, path: Place, value: Any) -> None:
    """Of a key that training alone reads, such as a prior, too."""
    before = msnn.load(file)
    for new in candidates(value):
        try:
            after = msnn.load(file, {".".join(map(str, path)): new})
        except SpecError:
            continue
        if not compare_specs(before, after).changes:
            continue
        assert compare_specs(before, after).kind == "model", new
        return
    pytest.fail(f"no other value than {value} may be written here: give `candidates` one")
