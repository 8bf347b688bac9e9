"""Provides the inputs for comparing exports with the reference: measured data or random samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from compiler.ir.program import Program, Signal
from msnn.data.dataset import FloatArray
from msnn.data.starts import reach
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.late_dataclass import dataclass

MOST_STEPS = 2000
"""Maximum number of compared steps."""
_DRAWN_STEPS = 500


@dataclass(frozen=True, slots=True)
class AgreementRecord:
    """Series of all signals, (rows, *shape), and the steps t0 … t0+steps−1 within them."""

    log: Mapping[str, FloatArray]
    t0: int
    steps: int
    origin: str
    """Description of the series' origin."""


def agreement_record(model: Model, program: Program, folder: Path) -> AgreementRecord:
    """The longest interval of the spec's data; random samples if no data can be read.

    `program` is the exported program in step form; the interval must contain one of its steps.
    """
    from msnn.data.reading.load import load_data

    # predictions are not compared with data here: their target rows may be missing
    program = _unscored(program)
    if model.spec.data is not None:
        try:
            data = load_data(program, model.spec.data, folder)
        except SpecError:
            return drawn_record(program, "drawn numbers, as the spec's data cannot be read")
        # longest of those without gap: a free run goes through all of it
        stretches = data.stretches()
        if len(stretches):
            start, stop = stretches[int(np.argmax(stretches[:, 1] - stretches[:, 0]))].tolist()
            log = {name: series[start:stop] for name, series in data.series.items()}
            file = next(r.file for r in data.records if r.start <= start < r.stop)
            found = _record(program, log, stop - start, f"the data in {file}")
            if found.steps > 0:
                return found
    return drawn_record(program, "drawn numbers")


def drawn_record(program: Program, origin: str) -> AgreementRecord:
    """Random samples within the signals' ranges, or [-1, 1], always the same ones (Philox)."""
    random = np.random.Generator(np.random.Philox(0))
    far = reach(program)
    rows = far.rows(_DRAWN_STEPS)
    log = {
        signal.name: random.uniform(*_limits(signal), (rows, *(axis.size for axis in signal.axes)))
        for signal in program.signals
    }
    return _record(program, log, rows, origin)


def _unscored(program: Program) -> Program:
    """The program without `predicts`, so that target rows may be missing."""
    return replace(program, outputs=tuple(replace(o, predicts=None) for o in program.outputs))


def _record(
    program: Program, log: Mapping[str, FloatArray], rows: int, origin: str
) -> AgreementRecord:
    far = reach(_unscored(program))
    # steps need what ports read ahead, and no rows beyond the last
    steps = min(rows - far.back - far.ahead, rows - far.back)
    # the states before the first step may read the log ahead (R7)
    if rows - far.back <= far.start_ahead:
        steps = 0
    return AgreementRecord(log, far.back, max(min(steps, MOST_STEPS), 0), origin)


def _limits(signal: Signal) -> tuple[float, float]:
    low, high = signal.range or (-1.0, 1.0)
    if not math.isfinite(low):
        # half-open ranges are made as wide as the default one
        low = high - 2.0 if math.isfinite(high) else -1.0
    return low, high if math.isfinite(high) else low + 2.0
