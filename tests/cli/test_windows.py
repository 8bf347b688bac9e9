"""What Windows lacks is not needed to start, and links that are refused are text files instead.

msnn is written for Windows and not tried there: this is what can be tried elsewhere.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import NoReturn

import pytest

import msnn as api
from msnn.cli.exit_codes import ExitCode
from msnn.project.new_project import new_project
from tests.cli.command_line import ROOT, CommandLine, in_new_process

OF_POSIX = {"fcntl", "grp", "posix", "pwd", "resource", "termios", "tty"}
_BLOCKED = f"""
import importlib, sys
for name in {sorted(OF_POSIX - {"posix"})!r}:
    sys.modules[name] = None
from msnn.cli.application import run
code = run(sys.argv[1:])
sys.exit(code)
"""


def _imported(tree: ast.Module) -> set[str]:
    """What a module imports while it is imported itself: not what stands in functions."""
    found: set[str] = set()
    open_nodes: list[ast.AST] = [tree]
    while open_nodes:
        node = open_nodes.pop()
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
                continue
            case ast.Import(names=names):
                found |= {alias.name.partition(".")[0] for alias in names}
            case ast.ImportFrom(module=str(module), level=0):
                found.add(module.partition(".")[0])
            case _:
                open_nodes.extend(ast.iter_child_nodes(node))
    return found


def test_no_module_imports_what_only_posix_has() -> None:
    for package in ("spec_schema", "compiler", "backends", "msnn"):
        for path in (ROOT / package).rglob("*.py"):
            imported = _imported(ast.parse(path.read_text(encoding="utf-8")))
            assert not imported & OF_POSIX, path


def test_looking_and_validating_work_without_them(tmp_path: Path) -> None:
    new_project(tmp_path / "plant")
    for verb in (
        ("check", "plant/plant.msnn.yaml"),
        ("validate", "--initial", "plant/plant.msnn.yaml", "--engine", "interpreter"),
        ("export", "--initial", "plant/plant.msnn.yaml", "--to", "c"),
    ):
        said = in_new_process(verb, tmp_path, start=_BLOCKED)
        assert said.code in (ExitCode.OK, ExitCode.LIMIT_BROKEN), said.err


@pytest.fixture
def _links_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, target: object, target_is_directory: bool = False) -> NoReturn:
        raise OSError(1314, "A required privilege is not held by the client")

    monkeypatch.setattr(Path, "symlink_to", refuse)


@pytest.mark.usefixtures("_links_are_refused")
def test_latest_is_a_text_file_where_links_are_refused(project: Path, msnn: CommandLine) -> None:
    for _ in range(2):
        said = msnn("train", "plant.msnn.yaml", "--set", "train.0.epochs=2")
        assert said.code == ExitCode.OK, said.err
    latest = project / "runs" / "plant" / "latest"
    run = sorted(path for path in latest.parent.iterdir() if path.is_dir())[-1]
    assert latest.read_text() == f"{run.name}\n"
    said = msnn("validate", "plant.msnn.yaml")
    assert said.code in (ExitCode.OK, ExitCode.LIMIT_BROKEN), said.err
    assert f"weights: runs/plant/{run.name}/weights.safetensors" in said.err
    shown = msnn("show", "runs/plant/latest")
    assert (shown.code, run.name in shown.out) == (ExitCode.OK, True), shown.err
    model = api.load("runs/plant/latest")
    assert model.run is not None
    assert model.run.resolve() == run
    by_link = api.simulate(model, weights="runs/plant/latest", horizon=2)[0].outputs["x_next"]
    by_name = api.simulate(model, weights=run, horizon=2)[0].outputs["x_next"]
    assert by_link.tolist() == by_name.tolist()
