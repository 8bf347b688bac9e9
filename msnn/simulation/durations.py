"""Converts durations in workflow sections to samples of a program."""

from __future__ import annotations

from compiler.lowering.context import LoweringFailed, Sampling
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.tree import Length


def samples(length: Length, sample_time: float | None, findings: Findings) -> int | None:
    """The number of samples; None after reporting a duration that is not a whole number of
    samples.
    """
    try:
        return Sampling(sample_time, findings).samples(length)
    # the compiler's own count has told why: 0.25 s is no whole number of samples of 0.1 s
    except LoweringFailed:
        return None
