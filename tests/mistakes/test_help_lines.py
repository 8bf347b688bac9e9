"""Whoever follows the help line of a typical mistake, word by word, has a file that works."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

import msnn
from msnn.model.model_data import read_data
from msnn.project.workflow_checks import checked_model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import SourceText
from tests.conditions import require_tool

FOLDER = Path(__file__).parent
BASE = (FOLDER / "plant.msnn.yaml").read_text(encoding="utf-8")
SPECS: list[dict[str, Any]] = yaml.safe_load((FOLDER / "specs.yaml").read_text(encoding="utf-8"))
DATA: list[dict[str, Any]] = yaml.safe_load((FOLDER / "data.yaml").read_text(encoding="utf-8"))
GOOD = next(case["csv"] for case in DATA if case["name"] == "a file mistyped")
_WRITE = re.compile(
    r"^(?:did you mean|for a product write|for a key write|in seconds it is"
    r"|write(?: for example| a number of samples such as)?) `([^`]+)`"
)
_KEYS = re.compile(r"`((?:columns|csv|time): [^`]+)`")
_ROUNDS = 4
"""A repaired mistake may show the next one, as in a spec with two."""


def changed(text: str, pairs: Sequence[Sequence[str]]) -> str:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def faults(text: str, folder: Path) -> tuple[Diagnostic, ...]:
    path = folder / "plant.msnn.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        checked_model(path)
    except SpecError as error:
        return tuple(found for found in error.diagnostics if found.severity == "error")
    return ()


def followed(text: str, fault: Diagnostic) -> str:
    """The text with what the help line says in the place that is underlined."""
    meant = _WRITE.match(fault.help or "")
    assert meant is not None, fault
    span = fault.span
    assert span is not None
    source = SourceText(span.file, text)
    lines = source.text.splitlines(keepends=True)
    start = sum(map(len, lines[: span.line - 1])) + span.column - 1
    end = sum(map(len, lines[: span.end_line - 1])) + span.end_column - 1
    return text[:start] + meant[1] + text[end:]


@pytest.mark.parametrize("case", SPECS, ids=lambda case: case["name"])
def test_a_spec_is_repaired(case: dict[str, Any], tmp_path: Path) -> None:
    text = changed(BASE, case["mistake"])
    found = faults(text, tmp_path)
    assert found, "it is no mistake"
    if "repair" in case:
        assert any(case["says"] in f"{fault.help} {fault.label}" for fault in found), found
        text = changed(text, case["repair"])
        assert faults(text, tmp_path) == ()
        return
    for _ in range(_ROUNDS):
        fault = next((each for each in found if _WRITE.match(each.help or "")), found[0])
        text = followed(text, fault)
        if not (found := faults(text, tmp_path)):
            return
    pytest.fail(f"still wrong: {found}")


def read(text: str, table: str, folder: Path) -> tuple[Diagnostic, ...]:
    """What reading the data for a training finds wrong."""
    (folder / "plant.msnn.yaml").write_text(text, encoding="utf-8")
    (folder / "log.csv").write_text(table, encoding="utf-8")
    try:
        read_data(msnn.load(folder / "plant.msnn.yaml"), None, "training")
    except SpecError as error:
        return tuple(found for found in error.diagnostics if found.severity == "error")
    return ()


@pytest.mark.parametrize("case", DATA, ids=lambda case: case["name"])
def test_data_are_read_or_repaired(case: dict[str, Any], tmp_path: Path) -> None:
    text, table = changed(BASE, case.get("mistake", ())), str(case["csv"])
    found = read(text, table, tmp_path)
    if "code" not in case:
        assert found == ()
        return
    assert found
    assert {fault.code for fault in found} == {case["code"]}
    if "says" in case:
        assert any(case["says"] in (fault.help or "") for fault in found), found
        text, table = changed(text, case.get("repair", ())), changed(table, case.get("file", ()))
    else:
        for fault in found:
            keys = _KEYS.findall(fault.help or "")
            if keys and keys[0] in text:
                continue
            if keys:  # "… under `data:`"
                text = text.replace("data:\n", f"data:\n  {keys[0]}\n", 1)
            else:
                text = followed(text, fault)
    assert read(text, table, tmp_path) == ()


@pytest.mark.parametrize("encoding", ["windows-1252", "utf-16"])
def test_a_table_of_another_encoding_is_converted(encoding: str, tmp_path: Path) -> None:
    require_tool("iconv", install="apt install libc-bin")
    table = GOOD.replace("time,F,x\n", "time,F,x,Größe\n").replace(",0\n", ",0,1\n")
    assert faults(BASE, tmp_path) == ()
    log = tmp_path / "log.csv"
    log.write_bytes(table.encode(encoding))
    with pytest.raises(SpecError) as caught:
        read_data(msnn.load(tmp_path / "plant.msnn.yaml"), None, "training")
    (fault,) = caught.value.diagnostics
    command = re.findall(r"`(iconv [^`]+)`", fault.help or "")[0]
    subprocess.run(["bash", "-c", command], check=True, cwd=tmp_path)
    assert read(BASE, (tmp_path / "utf8.csv").read_text(encoding="utf-8"), tmp_path) == ()


def test_there_are_sixty() -> None:
    names = [case["name"] for case in (*SPECS, *DATA)]
    assert len(set(names)) == len(names) >= 60
