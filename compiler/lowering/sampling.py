"""Converts durations and time offsets to whole samples; it never rounds silently (R1)."""

from __future__ import annotations

import math

from compiler.lowering.failure import LoweringFailed
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import time as errors
from spec_schema.expressions.tree import Duration, Length, Samples, TimeOffset

LONGEST_WINDOW = 1_000_000
# A duration such as 0.3 s at 0.1 s is 2.9999999999999996 samples in floating point.
_TOLERANCE = 1e-9
_BEYOND = 1e15


class Sampling:
    """Converts durations to samples for one sample time; reports durations that do not fit."""

    def __init__(self, sample_time: float | None, findings: Findings) -> None:
        self.sample_time = sample_time
        self._findings = findings

    def samples(self, length: Length) -> int:
        """Number of samples of a length.

        Raises LoweringFailed if it is not a multiple of the sample time.
        """
        match length:
            case Samples(count=count):
                found = count
            case Duration():
                found = self.from_seconds(length.seconds, length.quantity.text, length.span)
        if abs(found) > LONGEST_WINDOW:
            shown = f"{'at least ' if found == _BEYOND else ''}{found:,}"
            self._findings.report(errors.window_too_long(shown, LONGEST_WINDOW, length.span))
            raise LoweringFailed
        return found

    def offset(self, offset: TimeOffset) -> int:
        """Samples from t; negative in the past."""
        return offset.sign * self.samples(offset.length)

    def required(self, what: str, span: Span) -> float:
        """Seconds between samples; reports `what` as an error in a static model."""
        if self.sample_time is None:
            self._findings.report(errors.needs_sample_time(what, span))
            raise LoweringFailed
        return self.sample_time

    def from_seconds(self, seconds: float, text: str, span: Span) -> int:
        """Samples of a duration in seconds; `text` is its spelling in the spec."""
        sample_time = self.required(f"the duration {text}", span)
        # ∞ cannot be rounded; the limit is far above the longest window
        exact = min(seconds / sample_time, _BEYOND)
        nearest = round(exact)
        if abs(exact - nearest) > _TOLERANCE * max(1.0, abs(exact)):
            # 0 s is not a valid window or delay
            multiples = [each for each in (math.floor(exact), math.ceil(exact)) if each]
            nearest_texts = [_seconds_text(each * sample_time) for each in multiples]
            self._findings.report(
                errors.not_a_multiple(text, _seconds_text(sample_time), nearest_texts, span)
            )
            raise LoweringFailed
        return nearest


def _seconds_text(seconds: float) -> str:
    if seconds and abs(seconds) < 1:
        return f"{seconds * 1000:.9g} ms"
    return f"{seconds:.9g} s"
