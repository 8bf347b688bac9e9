"""Looks at the factors of rows before anything is trained or measured by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Loss, Output, Program
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.errors.data.rows import unfit_factor
from spec_schema.diagnostics.diagnostic import Findings

_AT_ONCE = 1 << 16


def check_row_factors(
    program: Program,
    data: Dataset,
    runs: Runs,
    rows: Mapping[str, BoolArray] | None,
    findings: Findings,
) -> None:
    """Reports factors that are no numbers ≥ 0, in rows that rollouts evaluate and that count."""
    checked: set[int] = set()
    for loss in program.losses:
        if loss.rows is None or loss.rows in checked:
            continue
        checked.add(loss.rows)
        t = _evaluated(runs, data.rows)
        if rows is not None:
            t = t[rows[loss.name][t]]
        factors = _factors(program, loss, loss.rows, data, t)
        bad = np.flatnonzero(~(np.isfinite(factors) & (factors >= 0)))
        if len(bad):
            row = int(t[bad[0]])
            value = float(factors[bad[0]])
            found = unfit_factor(
                loss.entry, value, data.record_of(row).place(row), len(bad), loss.span
            )
            findings.report(found)


def _evaluated(runs: Runs, rows: int) -> IntArray:
    """The rows t of all evaluations, each once."""
    # +1 where a rollout begins, −1 behind its end: the sum says how many evaluate a row
    changes = np.zeros(rows + 1, np.int64)
    # add.at: rollouts may begin in one row, which `changes[t0] += 1` would count once
    np.add.at(changes, runs.t0, 1)
    np.add.at(changes, runs.t0 + runs.steps, -1)
    return np.flatnonzero(np.cumsum(changes[:-1]))


def _factors(program: Program, loss: Loss, node: int, data: Dataset, t: IntArray) -> FloatArray:
    output = Output(loss.name, node)
    # factors read the log alone: nothing else of the step is computed
    alone = replace(program, outputs=(output,), losses=(), states=(), expected=(), fits=())
    judge = Interpreter(alone)
    parts = [
        judge.step(data.series, t[begin : begin + _AT_ONCE], {}, losses=False).outputs[loss.name]
        for begin in range(0, len(t), _AT_ONCE)
    ]
    return np.concatenate([np.zeros(0), *parts])
