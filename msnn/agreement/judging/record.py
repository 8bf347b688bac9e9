"""Makes the record along which exports meet the judge: measured data, or drawn numbers."""

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
"""Steps that are compared at most."""
_DRAWN_STEPS = 500


@dataclass(frozen=True, slots=True)
class AgreementRecord:
    """Series of all signals, (rows, *shape), and the steps t0 … t0+steps−1 that lie inside them."""

    log: Mapping[str, FloatArray]
    t0: int
    steps: int
    origin: str
    """What the series are, in words."""


def agreement_record(model: Model, program: Program, folder: Path) -> AgreementRecord:
    """The longest stretch of the spec's data, drawn numbers where it has none that can be read.

    `program` is what is exported, in step form; a stretch must hold one step of it.
    """
    from msnn.data.reading.load import load_data

    # what is predicted is compared with nothing here: its samples need not be in the record
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
    """Numbers within the signals' ranges, or [-1, 1], the same ones every time (Philox)."""
    random = np.random.Generator(np.random.Philox(0))
    far = reach(program)
    rows = far.rows(_DRAWN_STEPS)
    log = {
        signal.name: random.uniform(*_limits(signal), (rows, *(axis.size for axis in signal.axes)))
        for signal in program.signals
    }
    return _record(program, log, rows, origin)


def _unscored(program: Program) -> Program:
    """Without what outputs predict: the record need not reach that far."""
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
