"""Every broken spec in tests/bad_specs is answered with exactly the text beside it."""

from pathlib import Path
from zlib import crc32

import pytest
import yaml

from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.render import render
from spec_schema.reading.reader import read_spec
from tests.golden import assert_golden

FOLDER = Path(__file__).parents[1] / "bad_specs"
BROKEN = sorted([*FOLDER.glob("*.yaml"), *FOLDER.glob("*.json")], key=lambda path: path.name)
SAMPLE = [path for path in BROKEN if crc32(path.name.encode()) % 10 == 0]
"""About a tenth; a new file changes nothing of who the others are."""


def said_of(path: Path) -> str:
    """What `msnn check` says of a spec: the reader's diagnostics, or else the compiler's."""
    try:
        result = read_spec(path)
    except SpecError as error:
        return _shown(error, path)
    from compiler.elaboration.compile import compile_spec

    try:
        compiled = compile_spec(result.spec, used=result.used)
    except SpecError as error:
        return _shown(SpecError(error.diagnostics, result.sources), path)
    # A spec that compiles may still be here for its warnings.
    return _shown(SpecError((*result.warnings, *compiled.warnings), result.sources), path)


def _shown(error: SpecError, path: Path) -> str:
    text = render(error.diagnostics, "full", error.sources)
    return text.replace(f"{path.parent}/", "") + "\n"


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.name)
def test_broken_spec_is_answered_with_the_text_beside_it(path: Path, accept: bool) -> None:
    said = said_of(path)
    assert said.strip(), f"{path.name} has nothing wrong with it"
    code = path.name.split("_")[0]
    if code[0] in "EW" and code[1:].isdigit():
        assert f"[{code}]" in said, f"{path.name} is named after a code that it does not get"
    assert_golden(path.with_suffix(".txt"), said, accept)


@pytest.mark.parametrize("path", SAMPLE, ids=lambda path: path.name)
def test_the_answer_is_the_same_without_the_c_parser(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trees of all of them are compared in test_yaml_reader.py."""
    monkeypatch.delattr(yaml, "CSafeLoader")  # as where PyYAML is built without libyaml
    assert_golden(path.with_suffix(".txt"), said_of(path), accept=False)


def test_no_text_without_its_spec() -> None:
    specs = {path.stem for path in BROKEN}
    assert {path.stem for path in FOLDER.glob("*.txt")} <= specs
