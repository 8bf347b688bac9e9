"""Measures the cost of a trained model's C code: instructions, flash and RAM of a step."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from msnn.data.dataset import FloatArray
from msnn.exports.export import plan_exports, write_export
from msnn.model.model import Model
from msnn.training.records.run_log import Cost
from msnn.verification.bare_metal import board_checks
from msnn.verification.exported_c import read_exported_c
from msnn.verification.tools import ARM_GCC, ARM_QEMU, GCC, Tool
from spec_schema.diagnostics.diagnostic import Findings, SpecError

# the commonest core with single precision in hardware
_BOARD = frozenset({"m4"})
_NEEDS = (ARM_GCC, ARM_QEMU, GCC)


def missing_tools() -> tuple[Tool, ...]:
    """The missing tools for counting instructions."""
    return tuple(tool for tool in _NEEDS if not tool.is_there)


def c_cost(model: Model, weights: Mapping[str, FloatArray]) -> Cost | None:
    """The cost of the exported C code on an emulated Cortex-M4F (QEMU), at -O2.

    The code is that of `msnn export --to c`, measured over its golden steps. None if a tool is
    missing, or if the model cannot be exported to C.
    """
    if missing_tools():
        return None
    findings = Findings()
    plans = plan_exports(model, ("c",), findings, weights=weights)
    if findings.failed or not plans:
        return None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "c"
        try:
            write_export(plans[0], weights, folder)
            check = next(iter(board_checks(read_exported_c(folder), _BOARD)))
        except SpecError:  # what C cannot hold is the business of `export`
            return None
        result = check.result(Path(place) / "build")
    if not result.figures:
        return None
    (figures,) = result.figures
    _, mean, _ = figures.instructions
    ram = figures.data + figures.bss
    return Cost(f"{result.target}", mean, figures.flash, ram)
