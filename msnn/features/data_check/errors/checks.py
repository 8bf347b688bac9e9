"""W0810, W0812 to W0819, W0828, W0829: what measured data shows by itself, found by `msnn data`."""

from __future__ import annotations

from spec_schema.diagnostics.diagnostic import Diagnostic, warning


def uneven_steps(*, file: str, step: float, jitter: float, worst: float, row: int) -> Diagnostic:
    """W0810: rows that are not evenly spaced in time."""
    message = (
        f"the rows of {file} are {step:.6g} s apart, give or take {jitter:.2g} of that; "
        f"the step to row {row} is off by {worst:.2g}"
    )
    repair = "write `resample: linear` under `data:`, or take the rows as even: leave `time:` out"
    return warning("W0810", None, message, help=repair)


def gaps_in_time(*, file: str, count: int, longest: float, row: int) -> Diagnostic:
    """W0812: rows that are missing between others."""
    gaps = f"{count} gaps" if count > 1 else "a gap"
    message = f"{file} has {gaps} in its time, the longest of {longest:.6g} s before row {row}"
    repair = (
        "`resample: none` under `data:` makes an episode of each part, `linear` fills short ones"
    )
    return warning("W0812", None, message, help=repair)


def repeated_times(*, file: str, count: int, row: int, backward: bool) -> Diagnostic:
    """W0813: rows that are not later than the row before."""
    what = "back in time" if backward else "at the time of the row before"
    rows = f"{count} rows, the first is" if count > 1 else "one,"
    message = f"{file} has rows that are {what}: {rows} row {row}"
    repair = (
        "sort the rows by time and keep one of each time; after a clock was set: `resample: none`"
    )
    return warning("W0813", None, message, help=repair)


def missing_values(
    *, signal: str, count: int, rows: int, place: str, longest: int, is_input: bool
) -> Diagnostic:
    """W0814: values that a signal lacks."""
    message = (
        f"{count} of {rows} values of `{signal}` are missing, the first in {place}; "
        f"the longest run has {longest}"
    )
    repair = "values of targets that are missing are not scored"
    if is_input:
        repair = "`nan: split` under `data:` ends the episode there, `nan: drop` leaves records out"
    return warning("W0814", None, message, help=repair)


def spikes_found(*, signal: str, count: int, height: float, unit: str, place: str) -> Diagnostic:
    """W0815: values that jump away from their neighbours and back."""
    spikes = f"{count} spikes" if count > 1 else "a spike"
    message = f"`{signal}` has {spikes}, the highest of {height:.4g}{unit} in {place}"
    repair = (
        f"leave their cells empty where they are no motion (`nan: split`), or keep `{signal}` "
        "within limits by `filter:` under `data:`; `huber` in `losses:` weighs them less"
    )
    return warning("W0815", None, message, help=repair)


def stays_at_limit(
    *, signal: str, side: str, value: float, unit: str, rows: int, longest: int, place: str
) -> Diagnostic:
    """W0816: a signal that stays at its largest or smallest value as if something cut it."""
    message = (
        f"`{signal}` stays at its {side} value {value:.6g}{unit} in {rows} rows, "
        f"the longest time {longest} rows from {place} on"
    )
    relation = "<" if side == "largest" else ">"
    repair = (
        f"a sensor that saturates: `filter: {signal} {relation} {value:.6g}` under `data:`; "
        f"an actuator: `clip({signal}, low, high)` where the model reads it; "
        "what rests there, as a reference does, may stay"
    )
    return warning("W0816", None, message, help=repair)


def coarse_steps(
    *, signal: str, step: float, unit: str, levels: int, bits: float, share: float
) -> Diagnostic:
    """W0817: a signal that is rounded so coarsely that the rounding shows in every figure."""
    message = (
        f"`{signal}` has steps of {step:.4g}{unit}: {levels} values, {bits:.1f} bit of its span; "
        f"its rounding alone is {share:.1%} of its deviation"
    )
    repair = (
        f"no model of `{signal}` reaches a `fit` beyond {100 * (1 - share):.1f} %: set limits of "
        f"`validate:` above {step / 12**0.5:.2g}{unit} rmse, or record with more digits"
    )
    return warning("W0817", None, message, help=repair)


def constant_signal(*, signal: str, value: float | None, unit: str, where: str) -> Diagnostic:
    """W0818: a signal that never changes, or has no value at all."""
    if value is None:
        message = f"`{signal}` has no values in {where}"
        return warning(
            "W0818", None, message, help=f"look at its column: `columns: {{{signal}: …}}`"
        )
    message = f"`{signal}` is {value:.6g}{unit} in every row of {where}"
    repair = (
        f"nothing can be learned of it there: take it out of `inputs:`, write it as a constant, "
        f"or look at its column (`columns: {{{signal}: …}}`)"
    )
    return warning("W0818", None, message, help=repair)


def doubtful_unit(
    *, signal: str, unit: str, low: float, high: float, rather: str, reason: str
) -> Diagnostic:
    """W0819: values that would be odd in the unit of their signal and usual in another."""
    message = f"`{signal}` goes from {low:.4g} to {high:.4g} {unit}, which {reason}"
    repair = f"if the column is in {rather}: `columns: {{{signal}: {{column: …, unit: {rather}}}}}`"
    return warning("W0819", None, message, help=repair)


def little_of_range(
    *, signal: str, low: float, high: float, least: float, most: float, unit: str, share: float
) -> Diagnostic:
    """W0828: data that know little of the range that the spec declares."""
    message = (
        f"`{signal}` goes from {low:.4g} to {high:.4g}{unit} in the data, {share:.0%} of its range "
        f"{least:g} … {most:g}"
    )
    repair = f"beyond, the model extrapolates: record more, or narrow `range:` of `{signal}`"
    return warning("W0828", None, message, help=repair)


def too_few_rows(*, rows: int, longest: int, needed: int, of: str, resampled: bool) -> Diagnostic:
    """W0829: too few rows without gap to say anything of a response."""
    parts = f", at most {longest} of them in one part without gap," if longest < rows else ""
    message = f"{rows} rows with every value{parts} are too few to tell how `{of}` is moved"
    repair = f"{needed} rows in one part are enough: record for longer, "
    # where the spec resamples already, what lacks is values of the target
    lacking = f"with a value of `{of}` in every row"
    gaps = "or fill short gaps in time with `resample: linear` under `data:`"
    repair += lacking if resampled else gaps
    return warning("W0829", None, message, help=repair)
