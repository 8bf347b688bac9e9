"""Analyses a single series: values, spikes, saturation, quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.features.data_check.signals.quantisation import Quantisation, quantisation
from msnn.features.data_check.signals.saturation import Saturation, saturation
from msnn.features.data_check.signals.spikes import Spikes, spikes


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesCheck:
    """The properties of one series; NaN if it has no values."""

    rows: int
    """Number of rows, without those removed by a filter."""
    missing: int
    first_missing: int
    longest_missing: int
    mean: float
    deviation: float
    low: float
    high: float
    spikes: Spikes
    saturations: tuple[Saturation, ...]
    quantisation: Quantisation | None


def check_series(
    values: FloatArray, follows: BoolArray, lacks: BoolArray, left_out: int = 0
) -> SeriesCheck:
    """All properties of one series; `follows` is the mask of rows that continue the previous one.

    `lacks` is the mask of missing values; `left_out` rows are not counted.
    """
    known = values[np.isfinite(values)]
    return SeriesCheck(
        rows=len(values) - left_out,
        missing=int(lacks.sum()),
        first_missing=int(np.argmax(lacks)) if lacks.any() else 0,
        longest_missing=_longest(lacks),
        mean=float(np.mean(known)) if len(known) else np.nan,
        deviation=float(np.std(known)) if len(known) else np.nan,
        low=float(np.min(known)) if len(known) else np.nan,
        high=float(np.max(known)) if len(known) else np.nan,
        spikes=spikes(values, follows),
        saturations=saturation(values, follows),
        quantisation=quantisation(values),
    )


def _longest(wanted: BoolArray) -> int:
    """The maximum number of consecutive True values."""
    # edges of runs of True: begins and ends alternate
    edges = np.flatnonzero(np.diff(np.concatenate(([False], wanted, [False])).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
