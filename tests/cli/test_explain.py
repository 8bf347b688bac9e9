"""`msnn explain`: one code, several, all of them, and one that is none."""

from __future__ import annotations

import json

from spec_schema.diagnostics.explain import known_codes
from tests.cli.command_line import CommandLine


def test_a_code_is_explained_with_both_examples(msnn: CommandLine):
    said = msnn("explain", "e0301")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("E0301: a name that nothing declares\n")
    assert said.out.index("Wrong:") < said.out.index("Repaired:")


def test_without_a_code_all_are_listed(msnn: CommandLine):
    lines = msnn("explain").out.splitlines()
    assert [line.split()[0] for line in lines] == list(known_codes())


def test_an_unknown_code_gets_the_nearest(msnn: CommandLine):
    said = msnn("explain", "E0801", "E3010")
    assert (said.code, said.out) == (1, "")
    assert said.err.startswith("error[E1041]: `E3010` is not a diagnostic code\n")
    assert "did you mean `E" in said.err


def test_json(msnn: CommandLine):
    record = json.loads(msnn("explain", "--format", "json", "E0301", "W0301").out)
    assert (record["version"], record["command"]) == (1, "explain")
    assert [code["code"] for code in record["codes"]] == ["E0301", "W0301"]
    assert record["codes"][0]["markdown"].startswith("# E0301: ")
