"""Checks row factors and class labels before training or evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Loss, Measure, Output, Program
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.errors.data.rows import no_class, unfit_factor
from spec_schema.diagnostics.diagnostic import Findings

_AT_ONCE = 1 << 16


def check_row_factors(
    program: Program,
    data: Dataset,
    runs: Runs,
    rows: Mapping[str, BoolArray] | None,
    findings: Findings,
) -> None:
    """Reports factors that are negative or not finite, in scored rows of rollouts."""
    checked: set[int] = set()
    for loss in program.losses:
        if loss.rows is None or loss.rows in checked:
            continue
        checked.add(loss.rows)
        t = _evaluated(runs, data.rows)
        if rows is not None:
            t = t[rows[loss.name][t]]
        factors = _of_rows(program, loss, loss.rows, data, t)
        bad = np.flatnonzero(~(np.isfinite(factors) & (factors >= 0)))
        if len(bad):
            place, value = data.place(int(t[bad[0]])), float(factors[bad[0]])
            findings.report(unfit_factor(loss.entry, value, place, len(bad), loss.span))


def check_classes(program: Program, data: Dataset, runs: Runs, findings: Findings) -> None:
    """Reports labels that are not classes of a cross-entropy, in rows of rollouts."""
    for loss in program.losses:
        # of the measures with a target a mean alone has marks: NaN is missing, 0 is a class
        if loss.measure is not Measure.MEAN or loss.target is None:
            continue
        t = _evaluated(runs, data.rows)
        marks = _of_rows(program, loss, loss.target, data, t).reshape(len(t), -1)
        bad = np.argwhere((marks != 0) & ~np.isnan(marks))
        if len(bad):
            row, element = bad[0]
            place, value = data.place(int(t[row])), float(marks[row, element])
            findings.report(no_class(loss.entry, value, place, len(bad), loss.span))


def _evaluated(runs: Runs, rows: int) -> IntArray:
    """The rows t of all steps, each once."""
    # +1 where a rollout begins, −1 behind its end: the sum says how many evaluate a row
    changes = np.zeros(rows + 1, np.int64)
    # add.at: rollouts may begin in one row, which `changes[t0] += 1` would count once
    np.add.at(changes, runs.t0, 1)
    np.add.at(changes, runs.t0 + runs.steps, -1)
    return np.flatnonzero(np.cumsum(changes[:-1]))


def _of_rows(program: Program, loss: Loss, node: int, data: Dataset, t: IntArray) -> FloatArray:
    """The value of a node that depends only on data, in each of these rows."""
    output = Output(loss.name, node)
    # factors read the log alone: nothing else of the step is computed
    alone = replace(program, outputs=(output,), losses=(), states=(), expected=(), fits=())
    judge = Interpreter(alone)
    parts = [
        judge.step(data.series, t[begin : begin + _AT_ONCE], {}, losses=False).outputs[loss.name]
        for begin in range(0, len(t), _AT_ONCE)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)
