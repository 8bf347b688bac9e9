"""The extension for VS Code starts the server for the files that `msnn check` takes for specs."""

from __future__ import annotations

import json
import re
from pathlib import Path

from msnn.cli.application import VERBS
from msnn.cli.spec_files import spec_files

EXTENSION = Path(__file__).parents[3] / "editors" / "vscode"


def test_the_command_is_a_verb():
    package = json.loads((EXTENSION / "package.json").read_text())
    setting = package["contributes"]["configuration"]["properties"]["msnn.command"]
    program, verb = setting["default"]
    assert program == "msnn"
    assert verb in VERBS


def test_the_patterns_take_every_spec(tmp_path: Path):
    source = (EXTENSION / "src" / "extension.ts").read_text()
    patterns = re.findall(r'pattern: "\*\*/\*(\.[^"]+)"', source)
    endings = {ending for pattern in patterns for ending in _endings(pattern)}
    for ending in (*endings, ".yaml", ".json"):
        (tmp_path / f"a{ending}").write_text("")
    found = {path.name.removeprefix("a") for path in spec_files([tmp_path])}
    assert found == endings


def test_what_is_loaded_is_what_is_compiled():
    package = json.loads((EXTENSION / "package.json").read_text())
    options = json.loads((EXTENSION / "tsconfig.json").read_text())["compilerOptions"]
    assert package["main"] == f"./{options['outDir']}/extension.js"
    lock = json.loads((EXTENSION / "package-lock.json").read_text())["packages"][""]
    assert lock["dependencies"] == package["dependencies"]
    assert lock["devDependencies"] == package["devDependencies"]


def _endings(pattern: str) -> list[str]:
    """`.msnn.{yaml,yml}` written out."""
    found = re.fullmatch(r"(.*)\{(.*)\}", pattern)
    return [f"{found[1]}{word}" for word in found[2].split(",")] if found else [pattern]
