"""`msnn schema`: to stdout, or into a file."""

from __future__ import annotations

import json

from tests.cli.command_line import CommandLine


def test_stdout_and_file_hold_the_same(msnn: CommandLine):
    said = msnn("schema")
    assert (said.code, said.err) == (0, "")
    assert json.loads(said.out)["title"] == "msnn spec"
    written = msnn("schema", "--output", "editor/msnn.schema.json")
    assert (written.code, written.out) == (0, "")
    assert (msnn.folder / "editor" / "msnn.schema.json").read_text() == said.out


def test_a_folder_that_cannot_be_written_is_said(msnn: CommandLine):
    (msnn.folder / "file").write_text("")
    said = msnn("schema", "--output", "file/msnn.schema.json")
    assert said.code == 1
    assert "error[E1033]" in said.err
