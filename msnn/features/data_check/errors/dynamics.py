"""W0820 to W0827: what measured data shows of the system that made it, found by `msnn data`."""

from __future__ import annotations

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, warning


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
    *, signal: str, constant: float, rows: float, every: int | None
) -> Diagnostic:
    """W0822: a sample time that does not suit the time constant of the data."""
    message = (
        f"the slowest time constant of `{signal}` is {constant:.3g} s, {rows:.3g} sample times; "
        "10 to 30 are usual"
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


def short_horizon(*, signal: str, horizon: int, constant: float, key: str) -> Diagnostic:
    """W0824: rollouts of training that end before the slowest motion does."""
    rows = round(constant)
    message = (
        f"rollouts of {horizon} rows are shorter than the slowest time constant of `{signal}`, "
        f"{rows} rows: what drifts slowly is not trained"
    )
    return warning("W0824", None, message, help=f"write `{key}: {2 * rows}` or more")


def closed_loop_data(*, input: str, signal: str, share: float) -> Diagnostic:
    """W0825: an input that was made from the output that it should explain."""
    message = (
        f"the past of `{signal}` explains {share:.0%} of what is new in `{input}`: "
        "a controller was at work"
    )
    repair = (
        f"predict one step (`rollout: 1`) or simulate with an estimated start, and do not leave "
        f"the past of `{signal}` out; a reference signal added to `{input}` would tell both apart"
    )
    return warning("W0825", None, message, help=repair)


def dependent_inputs(*, input: str, formula: str, share: float) -> Diagnostic:
    """W0826: an input that other inputs determine."""
    message = f"`{input}` = {formula}, to {100 * share:.2f} % of its variance"
    repair = f"what is learned of each cannot be told apart: take `{input}` out of `inputs:`"
    return warning("W0826", None, message, help=repair)


def no_response(*, signal: str, inputs: Sequence[str], lags: int, chance: float) -> Diagnostic:
    """W0827: inputs without a visible response."""
    named = ", ".join(f"`{name}`" for name in inputs)
    message = (
        f"`{signal}` shows no response to {named} within {lags} rows "
        f"(a false alarm in {chance:.0%} of the cases)"
    )
    repair = "look at delay, columns and units, or take what has no influence out of `inputs:`"
    return warning("W0827", None, message, help=repair)
