"""Prints the analysis of errors: verdicts in words, and RMSE by region of inputs."""

from __future__ import annotations

from typing import Any

from msnn.tables import table_text
from msnn.validation.judged_errors import JudgedErrors
from msnn.validation.measurement import Measurement
from msnn.validation.reports.words import measured_as, unit_text
from msnn.validation.statistics.correlations import Correlation, ErrorsOfElement
from msnn.validation.statistics.coverage import LEVELS, Coverage


def residuals_table(measurements: tuple[Measurement, ...]) -> str:
    """One row per correlation of errors: with earlier errors, and with each earlier input."""
    rows = [
        row
        for found in measurements
        for each in found.judged.residuals
        for row in _rows(found, each)
    ]
    if not rows:
        return ""
    header = ("errors of", "against", "lags", "beyond 99 %", "largest", "at lag", "band", "n", "")
    return table_text(header, rows, numbers=range(2, 8))


def regions_table(measurements: tuple[Measurement, ...]) -> str:
    """One row per output and input: the RMSE in each quarter of the input's values."""
    rows = [
        (
            f"{_called(found)} by {signal}",
            *(f"{r.rmse:.4g} ({r.low:.3g} … {r.high:.3g})" for r in parts),
            *[""] * (4 - len(parts)),
            unit_text(found.unit),
        )
        for found in measurements
        for signal, parts in found.judged.regions.items()
        if len(parts) > 1
    ]
    if not rows:
        return ""
    return table_text(("rmse of", "1st quarter", "2nd", "3rd", "4th", "unit"), rows)


def coverage_table(measurements: tuple[Measurement, ...]) -> str:
    """One row per measurement: the coverage of the intervals of each level."""
    rows = [
        (
            _called(found),
            *(f"{share:.1%}" for share in coverage.observed),
            f"{coverage.half_width:.4g}",
            unit_text(found.unit),
            f"{coverage.from_parameters:.0%}",
            str(coverage.count),
            f"{coverage.effective:.0f}",
            coverage.verdict,
        )
        for found in measurements
        if (coverage := found.coverage) is not None
    ]
    if not rows:
        return ""
    levels = (f"in {level:.0%}" for level in LEVELS)
    width = f"± {LEVELS[-1]:.0%}"
    header = ("intervals of", *levels, width, "unit", "by parameters", "n", "worth", "")
    return table_text(header, rows, numbers=(1, 2, 3, 4, 6, 7, 8))


def coverage_record(found: Coverage | None) -> dict[str, Any]:
    """The coverage as JSON values; empty if no intervals were requested."""
    if found is None:
        return {}
    return {
        "intervals": {
            "levels": list(LEVELS),
            "inside": list(found.observed),
            "elements": found.elements.tolist(),
            "half_width": found.half_width,
            "from_parameters": found.from_parameters,
            "n": found.count,
            "effective": found.effective,
            "verdict": found.verdict,
        }
    }


def judged_record(found: JudgedErrors) -> dict[str, Any]:
    """The analysis of errors as JSON values."""
    return {
        "residuals": [
            {
                "element": list(each.element),
                "n": each.count,
                "itself": each.itself and _correlation_record(each.itself),
                "inputs": {name: _correlation_record(c) for name, c in each.inputs.items()},
                "feedback": {name: _correlation_record(c) for name, c in each.feedback.items()},
            }
            for each in found.residuals
        ],
        "regions": {
            name: [
                {"low": r.low, "high": r.high, "rmse": r.rmse, "scored": r.scored} for r in parts
            ]
            for name, parts in found.regions.items()
        },
        "outside_training": [
            {"signal": far.signal, "share": far.share, "low": far.low, "high": far.high}
            for far in found.extrapolations
        ],
    }


def _correlation_record(found: Correlation) -> dict[str, Any]:
    return {
        "verdict": "noise" if found.is_noise else "not noise",
        "lags": found.lags.tolist(),
        "values": found.values.tolist(),
        "band": found.band,
        "bands": found.bands.tolist(),
        "effective": found.effective,
    }


def _called(found: Measurement) -> str:
    return ", ".join(measured_as(found))


def _rows(found: Measurement, each: ErrorsOfElement) -> list[tuple[str, ...]]:
    called = _called(found)
    if each.element:
        called = f"{called} [{', '.join(map(str, each.element))}]"
    if each.itself is None:
        return [(called, "", "", "", "", "", "", str(each.count), "too few errors to judge")]
    # only rollouts of several steps have a curve over them
    said = _of_itself(each.itself, one_step=found.curve is None)
    rows = [_row(called, "themselves", each.itself, said)]
    for name, correlation in each.inputs.items():
        said = _of_input(name, correlation, each.feedback[name])
        rows.append(_row(called, name, correlation, said))
    return rows


def _row(called: str, against: str, found: Correlation, said: str) -> tuple[str, ...]:
    lag, largest = found.largest
    return (
        called,
        against,
        str(len(found.lags)),
        str(len(found.beyond)),
        f"{largest:.3f}",
        str(lag),
        f"{found.band:.3f}",
        f"{found.effective:.0f}",
        said,
    )


def _of_itself(found: Correlation, *, one_step: bool) -> str:
    if found.is_noise:
        return "white: what is left is noise"
    if one_step:
        return "not white: one error tells of the next, as noise of what one step reads does too"
    return "not white: one error tells of the next, the model lacks memory or a state"


def _of_input(name: str, found: Correlation, feedback: Correlation) -> str:
    if found.is_noise:
        follows = "" if feedback.is_noise else f"; {name} follows the output (feedback)"
        return f"independent of {name}{follows}"
    lag, _ = found.largest
    when = "at once" if lag == 0 else f"{lag} sample{'s' if lag > 1 else ''} later"
    return f"depends on {name}: what it does {when} is not in the model"
