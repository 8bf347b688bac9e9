"""Passes: functions from Program to Program with the same meaning, verified before and after."""

from __future__ import annotations

from collections.abc import Callable

from compiler.ir.program import Program
from compiler.ir.verifier import verify
from compiler.passes.simplify import drop_unused, fold_constants, share_common

PASSES: tuple[Callable[[Program], Program], ...] = (fold_constants, share_common, drop_unused)
"""The passes that every compiled program goes through, in this order."""


def run_passes(program: Program) -> Program:
    """Runs all `PASSES` and returns the result; verifies the program before and after each. Raises
    InvalidProgram if one is illegal.
    """
    verify(program)
    for run in PASSES:
        program = run(program)
        verify(program)
    return program
