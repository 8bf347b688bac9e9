"""Specs in fixed point for tests: their programs, their files, and what compilers make of them."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.exports.export import plan_exports
from msnn.exports.target import AnyPlan
from msnn.features.fixed_point.target import TARGET
from msnn.model.load import load_model
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Findings

GALLERY = Path(__file__).parents[3] / "examples" / "gallery"


def fixed_model(folder: Path, text: str, dtype: str) -> Model:
    """The model of a spec's text with its C export in that format."""
    path = folder / "model.msnn.yaml"
    if "export:" in text:
        text = text.replace("c: {}", f"c: {{dtype: {dtype}}}")
    else:
        text += f"\nexport: {{c: {{dtype: {dtype}}}}}\n"
    path.write_text(text, encoding="utf-8")
    return load_model(path)


def gallery_text(name: str) -> str:
    return (GALLERY / f"{name}.msnn.yaml").read_text(encoding="utf-8")


def planned(model: Model) -> AnyPlan:
    findings = Findings()
    (plan,) = plan_exports(model, ["c"], findings)
    assert not findings.failed, findings.in_order
    assert plan.target is TARGET
    return plan


def initial_weights(program: Program) -> Mapping[str, Any]:
    return physical_weights(program, {})


def run_test_program(folder: Path, prefix: str, compiler: str, flags: tuple[str, ...]) -> str:
    """Builds the export with its own test program and runs it; what it said."""
    sources = [*sorted((folder / "src").glob("*.c")), folder / "test" / f"{prefix}_sil.c"]
    built = folder / "test_program"
    command = [compiler, "-std=c99", *flags, "-I", str(folder / "include")]
    subprocess.run([*command, *map(str, sources), "-o", str(built)], check=True)
    return subprocess.run([built], check=True, capture_output=True, text=True).stdout
