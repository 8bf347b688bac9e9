"""`msnn fmt`: writes, checks, shows differences, refuses."""

from __future__ import annotations

from pathlib import Path

from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, change


def test_a_new_project_is_in_order(msnn: CommandLine, project: Path):
    said = msnn("fmt", "--check", SPEC)
    assert (said.code, said.out, said.err) == (0, "", "")


def test_it_writes_what_check_asks_for(msnn: CommandLine, project: Path):
    change(project, "integrator: rk4\n", "integrator: rk4   \n\n\n")
    before = (project / SPEC).read_bytes()
    assert msnn("fmt", "--check", SPEC).code == 1
    shown = msnn("fmt", "--diff", SPEC)
    assert shown.code == 1
    assert "\n-integrator: rk4   \n" in shown.out
    assert (project / SPEC).read_bytes() == before
    said = msnn("fmt", SPEC)
    assert (said.code, said.out, said.err) == (0, "", f"wrote {SPEC}\n")
    assert msnn("fmt", "--check", SPEC).code == 0


def test_it_writes_to_another_file_and_leaves_the_spec(msnn: CommandLine, project: Path):
    formatted = (project / SPEC).read_bytes()
    change(project, "integrator: rk4\n", "integrator: rk4   \n\n\n")
    before = (project / SPEC).read_bytes()
    assert msnn("fmt", SPEC, "-o", "other.yaml").code == 0
    assert (project / "other.yaml").read_bytes() == formatted
    said = msnn("fmt", SPEC, "-o", "-")
    assert (said.code, said.out.encode()) == (0, formatted)
    assert (project / SPEC).read_bytes() == before
    for words in ((SPEC, "other.yaml"), (SPEC, "--check"), (SPEC, "--diff")):
        assert msnn("fmt", *words, "-o", "third.yaml").code == 2
    assert msnn("fmt", SPEC, "-o", SPEC).code == 2
    assert (project / SPEC).read_bytes() == before
    assert not (project / "third.yaml").exists()


def test_line_ends_of_windows_are_replaced(msnn: CommandLine, project: Path):
    text = (project / SPEC).read_bytes()
    (project / SPEC).write_bytes(text.replace(b"\n", b"\r\n"))
    assert msnn("fmt", SPEC).code == 0
    assert (project / SPEC).read_bytes() == text


def test_a_spec_with_errors_is_left_alone(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x)")
    before = (project / SPEC).read_bytes()
    said = msnn("fmt", SPEC, "missing.yaml")
    assert said.code == 1
    assert "error[E0322]" in said.err
    assert "error[E1001]" in said.err
    assert (project / SPEC).read_bytes() == before
