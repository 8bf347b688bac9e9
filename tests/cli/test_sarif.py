"""`msnn check --format sarif`: a log of SARIF 2.1.0 that code hosts accept."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.render import render
from spec_schema.diagnostics.source import SourceText
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, change


def test_a_good_spec_gives_an_empty_run(msnn: CommandLine, project: Path):
    said = msnn("check", "--format", "sarif", SPEC)
    assert (said.code, said.err) == (0, "")
    (run,) = _legal(json.loads(said.out))["runs"]
    assert run["results"] == []


def test_every_file_is_in_one_log(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    (project / "my plant µ.yaml").write_text("msnn: 1\nname: a\n")
    said = msnn("check", "--format", "sarif", project / SPEC, "my plant µ.yaml", "missing.yaml")
    assert (said.code, said.err) == (1, "")
    (run,) = _legal(json.loads(said.out))["runs"]
    first, *rest = run["results"]
    assert first["ruleId"] == "E0301"
    assert "help: did you mean `k`?" in first["message"]["text"]
    (location,) = first["locations"]
    assert location["physicalLocation"] == {
        "artifactLocation": {"uri": "plant.msnn.yaml"},
        "region": {"startLine": 23, "startColumn": 17, "endLine": 23, "endColumn": 19},
    }
    second = rest[0]["locations"][0]["physicalLocation"]["artifactLocation"]
    assert second == {"uri": "my%20plant%20%C2%B5.yaml"}
    assert "locations" not in rest[-1]
    rules = {rule["id"]: rule for rule in run["tool"]["driver"]["rules"]}
    assert set(rules) == {"E0203", "E0301", "E1001"}
    assert "```yaml repaired" in rules["E0301"]["help"]["markdown"]


_BELOW = "msnn: 1\nname: b\ninputs: {v: {}}\noutputs: {y: {doc: 𝛼, expr: u}}\n"


def test_files_of_a_folder_are_named_from_the_current_one(msnn: CommandLine, project: Path):
    """Each by its own place, with all of its way, whether the folder is given in full or not."""
    below = project / "sub folder"
    below.mkdir()
    change(project, "k*x", "kk*x")
    (below / "b, 1: c.msnn.yaml").write_text(_BELOW)
    wanted = [
        ("plant.msnn.yaml", (23, 17, 19)),
        ("sub%20folder/b%2C%201%3A%20c.msnn.yaml", (4, 29, 30)),
    ]
    for folder in (".", str(project)):
        said = msnn("check", "--format", "sarif", folder)
        (run,) = _legal(json.loads(said.out))["runs"]
        places = [each["locations"][0]["physicalLocation"] for each in run["results"]]
        found = [
            (each["artifactLocation"]["uri"], (region["startLine"], *columns))
            for each in places
            for region in (each["region"],)
            for columns in ((region["startColumn"], region["endColumn"]),)
        ]
        assert found == wanted
    said = msnn("check", "--format", "github", "sub folder")
    place = "file=sub folder/b%2C 1%3A c.msnn.yaml,line=4,endLine=4,col=29,endColumn=29"
    assert said.err.startswith(f"::error title=E0301,{place}::unknown name `u`")


def test_other_places_and_files_elsewhere():
    source = SourceText("/elsewhere/a b.yaml", "k: 1\nk: 2\n")
    found = Diagnostic(
        code="E0105",
        severity="error",
        message="twice",
        span=source.span(5, 6),
        label="again",
        secondary=((source.span(0, 1), "first"),),
    )
    (run,) = _legal(json.loads(render([found], "sarif")))["runs"]
    (result,) = run["results"]
    place = result["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "file:///elsewhere/a%20b.yaml"
    assert result["relatedLocations"][0]["message"] == {"text": "first"}


def _legal(log: dict[str, Any]) -> dict[str, Any]:
    """The log, after a check of what the standard demands of the parts that are written."""
    assert set(log) == {"$schema", "version", "runs"}
    assert log["version"] == "2.1.0"
    for run in log["runs"]:
        assert run["columnKind"] in {"utf16CodeUnits", "unicodeCodePoints"}
        rules = run["tool"]["driver"]["rules"]
        assert run["tool"]["driver"]["name"]
        assert len({rule["id"] for rule in rules}) == len(rules)
        for rule in rules:
            assert rule["shortDescription"]["text"]
            assert rule["help"]["text"]
        for result in run["results"]:
            assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
            assert result["level"] in {"none", "note", "warning", "error"}
            assert result["message"]["text"]
            for location in (*result.get("locations", ()), *result.get("relatedLocations", ())):
                physical = location["physicalLocation"]
                uri = physical["artifactLocation"]["uri"]
                assert re.fullmatch(r"(file:///)?[A-Za-z0-9_.~%/-]+", uri), uri
                region = physical["region"]
                start = (region["startLine"], region["startColumn"])
                assert (1, 1) <= start <= (region["endLine"], region["endColumn"])
    return log
