"""W0810-W0829, W0847, E0827-E0829, E0882, E0883, E1130: messages about recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning


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
        "after a clock was set write `resample: none`; else sort the rows by time"
        if backward
        else "`duplicates: first`, `last` or `mean` under `data:` makes one row of them"
    )
    return warning("W0813", None, message, help=repair)


def missing_values(
    *,
    signal: str,
    count: int,
    rows: int,
    place: str,
    longest: int,
    is_input: bool,
    ended: str | None,
) -> Diagnostic:
    """W0814: values that a signal lacks."""
    # `ended` is the key of the spec that already ends episodes there
    message = (
        f"{count} of {rows} values of `{signal}` are missing, the first in {place}; "
        f"the longest run has {longest}"
    )
    repair = "values of targets that are missing are not scored"
    if is_input and ended is not None:
        repair = f"`{ended}` already ends the episode there; record `{signal}` without holes"
        if ended == "nan: drop":
            repair = "`nan: drop` already leaves such records out; `nan: split` keeps their parts"
    elif is_input:
        repair = (
            "training stops there (E0809): `nan: split` under `data:` ends the episode, "
            "`nan: drop` leaves records out"
        )
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
    *,
    signal: str,
    step: float,
    unit: str,
    levels: int,
    bits: float,
    share: float,
    may_switch: bool,
) -> Diagnostic:
    """W0817: a signal that is rounded so coarsely that the rounding shows in every figure."""
    message = (
        f"`{signal}` has steps of {step:.4g}{unit}: {levels} values, {bits:.1f} bit of its span; "
        f"its rounding alone is {share:.1%} of its deviation"
    )
    repair = (
        f"no model of `{signal}` reaches a `fit` beyond {100 * (1 - share):.1f} %"
        f"{' unless it rounds as well' if may_switch else ''}: set limits of "
        f"`validate:` above {step / 12**0.5:.2g}{unit} rmse, or record with more digits"
    )
    if may_switch:
        repair += f"; ignore this if `{signal}` is switched between these values"
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
    if longest >= needed:
        message = f"the {rows} rows with every value do not show how `{of}` is moved"
        repair = f"`{of}` does not change in them, or its values are too large or too small"
        return warning("W0829", None, message, help=repair)
    message = f"{rows} rows with every value are too few to tell how `{of}` is moved"
    if longest < rows:
        message = (
            f"the longest part without gap, {longest} of {rows} rows with every value, is too "
            f"short to tell how `{of}` is moved"
        )
    repair = f"{needed} rows in one part are enough: record for longer, "
    # where the spec resamples already, what lacks is values of the target
    lacking = f"with a value of `{of}` in every row"
    gaps = "or fill short gaps in time with `resample: linear` under `data:`"
    repair += lacking if resampled else gaps
    return warning("W0829", None, message, help=repair)


def delayed_response(
    *, signal: str, input: str, delay: int, seconds: str, ahead: int
) -> Diagnostic:
    """W0820: a response that comes later, or sooner, than the spec reads its input."""
    message = f"`{signal}` first answers `{input}` after {delay} rows{seconds}"
    if delay > ahead:
        later = delay - ahead
        note = f"an output that predicts `{_at(signal, ahead)}` reads newer values in vain"
        return warning("W0820", None, message, notes=(note,), help=f"read `{input}[t-{later}]`")
    message = f"`{signal}` answers `{input}` in the same row, before it is predicted"
    if delay:
        message = f"`{signal}` answers `{input}` after {delay} rows, before it is predicted"
    note = f"or `{input}` is computed from `{signal}`, by a controller"
    notes = (note,) if delay == 0 else ()
    repair = f"write `predicts: {_at(signal, delay)}` with `{input}` read up to `t`"
    if delay == 0:
        repair = f"write `between: linear` at `{input}` if it moves between rows, or {repair[6:]}"
    return warning("W0820", None, message, notes=notes, help=repair)


def _at(signal: str, ahead: int) -> str:
    return f"{signal}[t+{ahead}]" if ahead else f"{signal}[t]"


def weak_excitation(*, input: str, order: int, needed: int, highest: float | None) -> Diagnostic:
    """W0821: an input that excites less than the model has to learn."""
    band = "" if highest is None else f", with 99 % of its power below {highest:.3g} Hz"
    takes = f"to tell its delay and response takes {needed}"
    message = f"`{input}` excites {order} numbers at most{band}; {takes}"
    repair = (
        f"learn fewer (a shorter `window:` of what reads `{input}`, physics in `equations:`), or "
        "record steps of random length or more sines"
    )
    return warning("W0821", None, message, help=repair)


def sampling_of_system(
    *, signal: str, motion: str, rows: float, of: str, every: int | None
) -> Diagnostic:
    """W0822: a sample time that does not suit the time constant of the data."""
    message = (
        f"the {'fastest' if every is not None else 'slowest'} motion of `{signal}` {motion}, "
        f"{rows:.3g} sample times; 10 to 30 per {of} are usual"
    )
    repair = "record faster: what happens between rows is not in the data (`sample_time:`)"
    if every is not None:
        repair = f"`every: {every}` under `data:` with `sample_time:` {every} times as long: steps "
        repair += (
            "of neighbouring rows are mostly noise, and rollouts take as many evaluations less"
        )
    return warning("W0822", None, message, help=repair)


def short_window(
    *, output: str, input: str, window: int, settling: float, keys: Sequence[str]
) -> Diagnostic:
    """W0823: a window that ends before the response that it should hold."""
    rows = round(settling)
    message = (
        f"`{output}` reads {window} rows of `{input}`, whose response takes {rows} rows to settle"
    )
    named = " or ".join(f"`{key}: {rows}`" for key in keys) or f"a window of {rows} rows"
    repair = f"write {named}, or let the model keep a memory (`iir`, `state_space`, `states:`)"
    return warning("W0823", None, message, help=repair)


def short_horizon(
    *, signal: str, horizon: int, constant: float, least: float, key: str
) -> Diagnostic:
    """W0824: rollouts of training that end before the slowest motion does."""
    rows = round(constant)
    message = (
        f"rollouts of {horizon} rows are shorter than the slowest time constant of `{signal}`, "
        f"{rows} rows (at least {math.floor(least)}): slow drift is not trained"
    )
    return warning("W0824", None, message, help=f"write `{key}: {2 * rows}` or more")


def closed_loop_data(*, input: str, signal: str, share: float) -> Diagnostic:
    """W0825: an input that past values of the output help to predict."""
    message = (
        f"past values of `{signal}` help to predict `{input}`: they explain {share:.0%} of what "
        f"the past of `{input}` leaves open"
    )
    note = (
        f"a controller computes `{input}` from `{signal}`, or `{input}` is held or changes "
        "smoothly between rows"
    )
    repair = (
        f"with a controller, predict one step (`rollout: 1`) or simulate with an estimated start, "
        f"and do not leave the past of `{signal}` out; a reference signal added to `{input}` would "
        "tell both apart"
    )
    return warning("W0825", None, message, notes=(note,), help=repair)


def dependent_inputs(*, input: str, formula: str, share: float) -> Diagnostic:
    """W0826: an input that other inputs determine."""
    message = f"`{input}` = {formula}, to {100 * share:.2f} % of its variance"
    repair = f"what is learned of each cannot be told apart: take `{input}` out of `inputs:`"
    return warning("W0826", None, message, help=repair)


def no_response(
    *,
    signal: str,
    inputs: Sequence[str],
    lags: int,
    p_values: Sequence[float],
    static: float,
    limited: bool,
    elsewhere: bool,
) -> Diagnostic:
    """W0827: inputs without a visible response."""
    named = ", ".join(f"`{name}`" for name in inputs)
    chances = ", ".join(f"{value:.2g}" for value in p_values)
    message = (
        f"`{signal}` shows no response to {named} within {lags} rows (joint test: p = {chances})"
    )
    if limited:
        note = f"the recording cannot exclude a static effect on `{signal}`"
        if static < 1:
            note += f" below {static:.0%} of its deviation"
        repair = (
            f"keep {named}, and record longer or with larger steps; look at delays beyond "
            f"{lags} rows, columns and units"
        )
        return warning("W0827", None, message, notes=(note,), help=repair)
    note = f"a static effect above {static:.1%} of the deviation of `{signal}` is unlikely"
    repair = f"look at delays beyond {lags} rows, columns and units, or "
    repair += (
        f"leave it out of what predicts `{signal}`"
        if elsewhere
        else "take what has no influence out of `inputs:`"
    )
    return warning("W0827", None, message, notes=(note,), help=repair)


def set_point_as_input(*, signal: str, input: str, controller: str | None) -> Diagnostic:
    """W0847: an input that is the set-point of a controller, not an input of the plant."""
    if controller is None:
        message = (
            f"`{signal}` follows `{input}` in the long run, and its name says set-point: a "
            "controller seems to act between them"
        )
        repair = (
            f"for a model of the plant, take `{input}` out of `inputs:` and read the output of the "
            "controller; for a model of the closed loop, keep it"
        )
        return warning("W0847", None, message, help=repair)
    message = (
        f"`{input}` is the set-point of `{signal}`: a controller computes `{controller}` from "
        f"their difference, and `{input}` acts through `{controller}` alone"
    )
    repair = (
        f"for a model of the plant, take `{input}` out of `inputs:`; its errors on this recording "
        f"may rise, since it no longer learns the controller; for a model of the closed loop, take "
        f"`{controller}` out"
    )
    return warning("W0847", None, message, help=repair)


def no_table(file: str, format: str | None = None) -> Diagnostic:
    """E0827: a file in which `msnn init --data` finds no columns of numbers."""
    if format is not None:
        message = f"`init --data` reads tables of text and workbooks, and {file} is {format}"
        repair = f"begin with `msnn init NAME`, and write `data: {{source: {{train: {file}}}}}`"
        return error("E0827", None, message, help=repair)
    message = f"{file} has no lines of numbers with cells between `,`, `;`, `|` or tabs"
    return error("E0827", None, message, help="other formats are read by a spec: `data:`")


def no_target(file: str) -> Diagnostic:
    """E0828: a file in which no column but the time moves."""
    message = f"no column of {file} but the time changes: there is nothing to predict"
    return error("E0828", None, message, help="record the signals while the system moves")


def few_rows(file: str, rows: int, needed: int) -> Diagnostic:
    """E0829: a file with too few rows to train and to validate."""
    message = f"{file} has {rows} rows, too few to train on some and to validate on others"
    return error("E0829", None, message, help=f"at least {needed} are needed")


def unlike_files(first: str, file: str, reason: str) -> Diagnostic:
    """E0882: files that are no recordings of one set."""
    message = f"{file} cannot be in one set with {first}: {reason}"
    repair = "give files with the same columns, units and sample time, or make a spec of each"
    return error("E0882", None, message, help=repair)


def no_such_files(pattern: str) -> Diagnostic:
    """E0883: a pattern of `--data` that matches no file."""
    message = f"no file matches `{pattern}`"
    return error("E0883", None, message, help="look at the folder: `ls`")


def falling_time(file: str, column: str) -> Diagnostic:
    """E1130: a file whose last row is the first in time."""
    message = f"`{column}` of {file} falls from row to row: a record goes forward in time"
    repair = f"sort its rows by `{column}`; if that is no time, give the column another name"
    return error("E1130", None, message, help=repair)
