"""The process answers over its streams as it must for VS Code, whatever it is sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from msnn.cli.application import run
from msnn.cli.exit_codes import ExitCode
from msnn.features.language_server.knowledge import examine
from msnn.features.language_server.problems import problems_of
from msnn.packages import PYGLS
from tests.conditions import require_package
from tests.features.language_server.client import Client, editor
from tests.features.language_server.marked import PLANT
from tests.features.language_server.test_diagnostics import SPECS, text_of

_WRONG = PLANT.replace("gain * sum", "gian * sum")


@pytest.fixture(autouse=True)
def pygls() -> None:
    require_package("pygls", "pip install pygls")


def test_a_session_as_an_editor_has_it(tmp_path: Path):
    path = tmp_path / "plant.msnn.yaml"
    with editor(tmp_path) as client:
        _have_session(client, path)


def _have_session(client: Client, path: Path) -> None:
    assert client.can["positionEncoding"] == "utf-16"
    client.open(path, _WRONG)
    (found,) = client.diagnostics(path)
    assert (found["code"], found["source"], found["severity"]) == ("E0301", "msnn", 1)
    assert found["range"] == _range(14, 8, 12)

    asked = {"range": found["range"], "context": {"diagnostics": [found]}}
    (action,) = client.request("textDocument/codeAction", _of(path) | asked)
    (edit,) = action["edit"]["changes"][path.as_uri()]
    assert edit == {"range": found["range"], "newText": "gain"}
    client.change(path, f"# a line more\n{_WRONG}")
    late = client.request("textDocument/codeAction", _of(path) | asked)
    assert late == [], "its places are of a text that is no more"
    client.change(path, PLANT)
    assert client.diagnostics(path) == []

    said = client.at("hover", path, 14, 9)
    assert said["contents"]["value"].startswith(
        "**gain**, a parameter\n\ntype `scalar`, unit `1/N`"
    )
    assert said["range"] == _range(14, 8, 12)
    assert client.at("definition", path, 14, 9) == {"uri": path.as_uri(), "range": _range(8, 2, 6)}
    proposed = client.at("completion", path, 14, 10)
    assert [item["label"] for item in proposed["items"]] == ["gain"]
    assert proposed["items"][0]["textEdit"] == {"range": _range(14, 8, 10), "newText": "gain"}
    symbols = client.request("textDocument/documentSymbol", _of(path))
    inputs = next(symbol for symbol in symbols if symbol["name"] == "inputs")
    assert [child["name"] for child in inputs["children"]] == ["force", "speed"]
    assert client.end() == 0


def test_an_open_sub_model_is_checked_where_it_is_used(tmp_path: Path):
    part, whole = tmp_path / "part.msnn.yaml", tmp_path / "whole.msnn.yaml"
    fine = "msnn: 1\nname: part\ninputs: {u: {}}\noutputs: {y: 2 * u}\n"
    part.write_text(fine)
    with editor(tmp_path) as client:
        text = (
            "msnn: 1\nname: whole\nuse: {p: part.msnn.yaml}\ninputs: {a: {}}\n"
            "connect: {p.u: a}\noutputs: {z: p.y}\n"
        )
        client.open(whole, text)
        assert client.diagnostics(whole) == []
        client.open(part, fine)
        client.diagnostics(part)
        assert client.diagnostics(whole) == [], "an open file that is used is looked at again"
        client.change(part, fine.replace("2 * u", "2 * v"))
        (found,) = client.diagnostics(whole)
        (place,) = found["relatedInformation"]
        assert place["location"]["uri"] == part.as_uri()
        assert client.close_text(part) == [], "nobody looks at it any more"
        assert client.diagnostics(whole) == [], "the file on the disk holds again"
        part.write_text(fine.replace("2 * u", "2 * v"))
        client.notify("workspace/didChangeWatchedFiles", {"changes": []})
        assert len(client.diagnostics(whole)) == 1, "another program has written it"
        part.write_text(fine)
        client.notify("textDocument/didSave", _of(whole))
        assert client.diagnostics(whole) == []


def test_broken_specs_are_underlined_as_check_says(tmp_path: Path):
    with editor(tmp_path) as client:
        for path in (*SPECS[::60], *(path for path in SPECS if path.suffix == ".json")):
            text = text_of(path)
            if text is None:
                continue
            client.open(path, text)
            found = [
                (each["code"], each["message"].splitlines()[0], each["range"]["start"])
                for each in client.diagnostics(path)
            ]
            problems = problems_of(examine(str(path), text, {}), str(path))
            assert found == [
                (
                    problem.diagnostic.code,
                    problem.text.splitlines()[0],
                    {
                        "line": problem.range.start.line,
                        "character": problem.range.start.character,
                    },
                )
                for problem in problems
            ]


_HOSTILE = (
    "",
    "\0",
    "\ud800: \udfff",
    "|",
    "- " * 3000,
    "{" * 3000,
    "[" * 3000 + "]" * 3000,
    "a: &a [*a]",
    "inputs: " + " " * 100_000 + "x",
    "a" * 100_000,
    "a " * 50_000,
    "a: " + "a" * 100_000 + "  ",
    "msnn: 1\nuse:\n  a: " + "x." * 3000,
    "\n" * 20_000 + "x",
    'inputs: {"' * 2000,
    "msnn: 1\nname: x\ninputs: {u: {}}\noutputs:\n  y: " + "(" * 2000 + "u" + ")" * 2000,
    "msnn: 1\nname: x\ninputs: {u: {}}\noutputs:\n  y: " + "u**" * 1000 + "u",
    "msnn: 1\nuse: {a: /dev/zero, b: ., c: plant.msnn.yaml}\n",
    "\u2028\u0085\x0b: \x0c\r\r\n\r",
)


def test_hostile_texts_are_answered_and_a_good_one_after_them(tmp_path: Path):
    path = tmp_path / "plant.msnn.yaml"
    with editor(tmp_path) as client:
        client.open(path, PLANT)
        client.diagnostics(path)
        for text in _HOSTILE:
            client.change(path, text)
            assert client.diagnostics(path), text[:40]
            line = text.count("\n") // 2
            for character in (0, 9, 10**9):
                for method in ("hover", "definition", "completion"):
                    client.at(method, path, line, character)
            client.at("completion", path, 10**9, 0)
            client.request("textDocument/documentSymbol", _of(path))
        client.send_bytes(b"Content-Length: 7\r\n\r\n{wrong}")
        client.notify("textDocument/didChange", {"nonsense": 1})
        client.notify("no/such", None)
        client.change(path, PLANT)
        assert client.diagnostics(path) == []
        assert client.end() == 0


def test_an_editor_that_is_gone_ends_the_process(tmp_path: Path):
    with editor(tmp_path) as client:
        client.open(tmp_path / "plant.msnn.yaml", PLANT)
        assert client.process.stdin is not None
        client.process.stdin.close()
        assert client.process.wait(120) == 0


def test_without_its_package_the_line_that_installs_it_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(type(PYGLS), "is_installed", property(lambda package: False))
    assert run(["lsp"]) == ExitCode.MISSING_EXTRA
    said = capsys.readouterr().err
    assert "pygls, which speaks the protocol of editors," in said
    assert PYGLS.install in said


def _of(path: Path) -> dict[str, Any]:
    return {"textDocument": {"uri": path.as_uri()}}


def _range(line: int, first: int, last: int) -> dict[str, Any]:
    return {
        "start": {"line": line, "character": first},
        "end": {"line": line, "character": last},
    }
