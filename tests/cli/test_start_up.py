"""The command line starts light: what is only looked at waits for no numerical library."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command_line import in_new_process

_HEAVY = ("torch", "casadi", "onnx", "onnxruntime", "matplotlib", "rich", "scipy")
_START = f"""
import sys
from msnn.cli.application import run
code = run(sys.argv[1:])
loaded = [name for name in {_HEAVY!r} if name in sys.modules]
print("loaded:", *loaded, file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("train", "--help"),
        ("check", "plant.msnn.yaml"),
        ("show", "plant.msnn.yaml"),
        ("show", "--program", "plant.msnn.yaml"),
        ("check", "--format", "sarif", "plant.msnn.yaml"),
        ("explain", "E0301"),
        ("schema",),
        ("doctor",),
        ("fmt", "--check", "plant.msnn.yaml"),
        ("diff", "plant.msnn.yaml", "plant.msnn.yaml"),
        ("show", "--resolved", "plant.msnn.yaml"),
        ("show", "--graph", "mermaid", "plant.msnn.yaml"),
        ("show", "--latex", "plant.msnn.yaml"),
        ("show", "--interface", "plant.msnn.yaml"),
        ("compile", "plant.msnn.yaml"),
        ("validate", "--initial", "plant.msnn.yaml", "--set", "validate=[{of: x_next}]"),
    ],
    ids=" ".join,
)
def test_these_import_nothing_heavy(project: Path, arguments: tuple[str, ...]):
    said = in_new_process(arguments, project, start=_START)
    assert said.code == 0, said.err
    assert said.err.splitlines()[-1] == "loaded:"


def test_importing_msnn_imports_next_to_nothing(project: Path):
    start = (
        "import sys, msnn; print(*(m for m in ('numpy', 'pydantic', 'yaml') if m in sys.modules))"
    )
    said = in_new_process((), project, start=start)
    assert (said.code, said.out) == (0, "\n")
