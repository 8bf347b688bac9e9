"""Every diagnostic code has one constructor, in the file of its range, and is used."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.message_files import ROOT, message_files

_CODE = re.compile(r"[EW][01]\d{3}")


def _constructors() -> Iterator[tuple[Path, ast.FunctionDef]]:
    for path in message_files():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            match node:
                case ast.FunctionDef(returns=ast.Name("Diagnostic")):
                    yield path, node
                case _:
                    pass


CONSTRUCTORS = list(_constructors())


def test_every_file_of_errors_is_looked_at() -> None:
    looked_at = {path for path, _ in CONSTRUCTORS}
    for path in message_files():
        has_codes = _CODE.search(path.read_text(encoding="utf-8")) is not None
        assert path in looked_at or not has_codes or path.stem == "__init__", path


@pytest.mark.parametrize(
    "constructor", [node for _, node in CONSTRUCTORS], ids=lambda node: node.name
)
def test_docstring_starts_with_the_codes(constructor: ast.FunctionDef) -> None:
    written = {
        node.value
        for node in ast.walk(constructor)
        if isinstance(node, ast.Constant) and _CODE.fullmatch(str(node.value))
    }
    assert written, "a constructor names its code"
    said = (ast.get_docstring(constructor) or "").split(":")[0]
    assert set(_CODE.findall(said)) == written


def test_codes_are_unique() -> None:
    owners: dict[str, str] = {}
    for path, constructor in CONSTRUCTORS:
        docstring = ast.get_docstring(constructor) or ""
        for code in _CODE.findall(docstring.split(":")[0]):
            name = f"{path.stem}.{constructor.name}"
            assert owners.setdefault(code, name) == name, f"{code} is taken"


def test_every_constructor_is_used() -> None:
    of_messages = set(message_files())
    words = {
        word
        for package in ("spec_schema", "compiler", "backends", "msnn")
        for path in (ROOT / package).rglob("*.py")
        if path not in of_messages or path.stem == "failures"
        for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))
    }
    unused = [c.name for _, c in CONSTRUCTORS if c.name not in words]
    assert not unused, f"nothing reports {unused}: use or remove them"


def test_reader_codes_have_a_broken_spec() -> None:
    """The two that have none are caps of size and a file that is not there."""
    shown = {path.name.split("_")[0] for path in (ROOT / "tests" / "bad_specs").iterdir()}
    for path, constructor in CONSTRUCTORS:
        if path.stem in {"yaml_text", "schema", "expressions"}:
            code = (ast.get_docstring(constructor) or "").split(":")[0]
            assert code in shown | {"E0119"}, f"{code} {constructor.name}"
