"""E02xx: the schema of a spec, its sections, keys and plain values."""

from collections.abc import Iterable, Mapping

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest, with_decimal_point
from spec_schema.names import LONGEST_NAME, similar_name

# The keys of a layer are worth listing, those of a whole spec are in the documentation.
_SHORT_LIST = 12


def unknown_key(
    key: str, span: Span, owner: str, known: Iterable[str], present: str | None = None
) -> Diagnostic:
    """E0201: a key that the language does not have."""
    known = tuple(known)
    # the name of today of the same key: it is there too
    if present is not None:
        message = f"`{key}` in {owner} is the old name of `{present}`, which is there too"
        return error("E0201", span, message, "twice the same key", help=f"remove `{key}`")
    # a key of another tool is worth more than one of like letters, if this entry has it
    elsewhere = (meant for meant in KEYS_ELSEWHERE.get(key.lower(), ()) if meant in known)
    meant = next(elsewhere, None)
    needed, form = FORMS_ELSEWHERE.get(key.lower(), ("", ""))
    message = f"unknown key `{key}` in {owner}"
    # the same idea in another form: no replacement, since key and value both change
    if meant is None and needed in known:
        return error("E0201", span, message, "no such key", help=f"write {form}")
    meant = meant or nearest(key, known)
    notes = () if meant else (f"known keys: {', '.join(known)}",)
    repair = did_you_mean(meant)
    return error("E0201", span, message, "no such key", notes=notes, help=repair, replacement=meant)


def key_not_yet(key: str, span: Span, owner: str, known: Iterable[str]) -> Diagnostic:
    """E0202: a key of the full language that this version does not read."""
    known = tuple(known)
    message = f"`{key}` in {owner} is not in this version of msnn"
    notes = (f"available here: {', '.join(known)}",) if len(known) <= _SHORT_LIST else ()
    return error("E0202", span, message, "planned, not available yet", notes=notes)


def former_key(key: str, present: str, span: Span, owner: str) -> Diagnostic:
    """W0220: a key by the name that it had in an older version."""
    message = f"`{key}` in {owner} is called `{present}` now"
    return warning(
        "W0220", span, message, "old name", help=f"write `{present}`", replacement=present
    )


def seldom_unit(symbol: str, size: str, meant: str, span: Span) -> Diagnostic:
    """W0221: an unusual unit, where probably another one is meant."""
    message = f"`{symbol}` is {size}"
    repair = f"write `{meant}` if that is meant"
    if meant == "deg":
        repair += ", or `gon` for gradians"
    return warning("W0221", span, message, "another unit?", help=repair, replacement=meant)


def missing_key(key: str, span: Span, owner: str) -> Diagnostic:
    """E0203: a key that must be there."""
    message = f"{owner} needs the key `{key}`"
    repair = "add `msnn: 1`" if key == "msnn" else f"add `{key}:`"
    return error("E0203", span, message, f"`{key}` is missing here", help=repair)


def wrong_kind(
    wanted: str,
    found: str,
    span: Span,
    repair: str | None = None,
    meant: str | None = None,
) -> Diagnostic:
    """E0204: a value of the wrong kind."""
    message = f"expected {wanted}, found {found}"
    return error("E0204", span, message, f"this is {found}", help=repair, replacement=meant)


def malformed_name(name: str, span: Span) -> Diagnostic:
    """E0205: a name that expressions could not use, or that is too long."""
    if max(map(len, name.split("."))) > LONGEST_NAME:
        message = f"`{name[:20]}…` is too long for a name"
        repair = f"a name has at most {LONGEST_NAME} characters"
        return error("E0205", span, message, f"{len(name)} characters", help=repair)
    similar = similar_name(name)
    repair = f"write for example `{similar}`" if similar else None
    if name.isdecimal():
        repair = (
            "name a dimension of `dims:`, where its size stands; leave the key out for one number"
        )
    label = "a name is made of letters (Latin or Greek), digits and `_`, and starts with a letter"
    message = f"`{name}` is not a name"
    return error("E0205", span, message, label, help=repair, replacement=similar)


def malformed_member(name: str, span: Span) -> Diagnostic:
    """E0229: a key that is to name an input of a sub-model."""
    message = f"`{name}` does not name an input of a sub-model"
    repair = "write the name of the sub-model, a dot and its input: `plant.u: …`"
    return error("E0229", span, message, "not a name with a dot", help=repair)


def reserved_name(name: str, span: Span, reason: str) -> Diagnostic:
    """E0206: a name that the language reserves."""
    repair = f"choose another name, for example `{name}_`"
    return error("E0206", span, f"`{name}` cannot be declared: {reason}", "reserved", help=repair)


def unknown_choice(
    text: str, span: Span, choices: Iterable[str], meant: str | None = None
) -> Diagnostic:
    """E0207: a word that is not one of the choices."""
    # `meant` is the one that other programs call so
    choices = tuple(choices)
    meant = meant or nearest(text, choices)
    message = f"`{text}` is not one of {', '.join(choices)}"
    repair = did_you_mean(meant)
    return error("E0207", span, message, "unknown choice", help=repair, replacement=meant)


def one_variant(owner: str, span: Span, found: Iterable[str], choices: Iterable[str]) -> Diagnostic:
    """E0209: no variant or several, where exactly one is required."""
    found = tuple(found)
    said = f"has {' and '.join(found)}" if found else "has none"
    message = f"{owner} takes exactly one of {', '.join(choices)}; this one {said}"
    return error("E0209", span, message, "choose one")


def out_of_range(text: str, span: Span, wanted: str, repair: str | None = None) -> Diagnostic:
    """E0210: a number outside what the key allows."""
    return error("E0210", span, f"`{text}` is out of range", f"must be {wanted}", help=repair)


def old_boolean(text: str, span: Span) -> Diagnostic:
    """E0211: yes, no, on, off, which were booleans in YAML 1.1."""
    meant = "true" if text.lower() in {"yes", "on", "y"} else "false"
    message = f"`{text}` is text, not true or false"
    repair = f"write `{meant}`"
    return error("E0211", span, message, "text in YAML 1.2", help=repair, replacement=meant)


def empty_value(wanted: str, span: Span) -> Diagnostic:
    """E0212: a key with nothing after it."""
    return error("E0212", span, f"expected {wanted}, found nothing", "empty")


def unknown_language(text: str, span: Span) -> Diagnostic:
    """E0214: a spec of another language version."""
    message = f"`msnn: {text}` is not a language version this msnn reads"
    repair = "write `msnn: 1`"
    return error("E0214", span, message, "unknown version", help=repair, replacement="1")


def empty_section(owner: str, span: Span) -> Diagnostic:
    """E0215: an empty section that needs a content."""
    return error("E0215", span, f"{owner} must not be empty", "nothing in it")


def malformed_length(text: str, span: Span, *, may_be_date: bool = False) -> Diagnostic:
    """E0216: neither samples nor a duration."""
    message = f"`{text}` is not a length of time{' and not a date' if may_be_date else ''}"
    notes = ("the units of a duration are us, ms, s, min and h",)
    repair = "write a number of samples such as `5`, or a duration such as `50 ms`"
    meant = with_decimal_point(text)
    if meant is not None:
        repair = f"write `{meant}`"
    elif may_be_date:
        repair += "; a date is one of ISO 8601, such as `2026-11-22 17:00`"
    return error(
        "E0216", span, message, "not a length", notes=notes, help=repair, replacement=meant
    )


def malformed_sample_time(text: str, span: Span) -> Diagnostic:
    """E0217: a sample time that is neither a time nor a frequency."""
    label = "write a positive time such as `50 ms`, or a frequency such as `20 Hz`"
    meant = with_decimal_point(text)
    repair = f"write `{meant}`" if meant else None
    if (meant or text).replace(".", "", 1).isdigit():
        meant = f"{meant or text} s"
        repair = f"in seconds it is `{meant}`"
    message = f"`{text}` is not a sample time"
    return error("E0217", span, message, label, help=repair, replacement=meant)


def malformed_quantity(text: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0218: neither a number nor a number with a unit."""
    message = f"`{text}` is not a quantity"
    label = "write a number, or a number and a unit such as `2 mm`"
    meant = with_decimal_point(text)
    repair = f"write `{meant}`" if meant else repair
    return error("E0218", span, message, label, help=repair, replacement=meant)


def malformed_prediction(span: Span) -> Diagnostic:
    """E0219: `predicts` with something else than a sample of a signal."""
    message = "`predicts` names one sample of a logged signal"
    repair = "write for example `predicts: x[t+1]`"
    return error("E0219", span, message, "not a signal at t or later", help=repair)


def list_for_expression(span: Span) -> Diagnostic:
    """E0221: YAML read a list or mapping where an expression was meant."""
    message = "expected an expression, found a YAML list or mapping"
    label = "YAML reads brackets at the start of a value as its own"
    return error("E0221", span, message, label, help="put the whole expression in quotes")


def malformed_columns(text: str, span: Span) -> Diagnostic:
    """E0222: a column pattern that cannot be expanded."""
    message = f"`{text}` is not a column pattern"
    return error("E0222", span, message, "a pattern has one ascending range, as in `tau{1..6}`")


def misfitting_split(problem: str, span: Span, repair: str) -> Diagnostic:
    """E0223: a split whose keys do not fit each other."""
    return error("E0223", span, problem, "does not fit", help=repair)


def ambiguous_thousands(sign: str, role: str, span: Span | None, repair: str) -> Diagnostic:
    """E0890: one character between groups of three digits that also has another role."""
    message = f"`{sign}` is the sign of thousands and {role}"
    return error("E0890", span, message, "one sign with two meanings", help=repair)


def reversed_range(low: str, high: str, span: Span) -> Diagnostic:
    """E0224: a range whose ends are in the wrong order."""
    return error("E0224", span, f"the range [{low}, {high}] is empty", "low must be below high")


def repeated_item(text: str, span: Span, first: Span, *, is_dim: bool = False) -> Diagnostic:
    """E0225: an item twice in a list of different things."""
    message = f"`{text}` stands twice in this list"
    repair = "leave one of them out, or give one another name"
    if is_dim:
        repair = (
            f"declare a second dim of the same size, `dims: {{{text}2: …}}`, and write "
            f"`[{text}2, {text}]`: of an x along `{text}`, `A @ x` is along `{text}2`"
        )
    return error(
        "E0225", span, message, "again here", secondary=((first, "first here"),), help=repair
    )


def excluded_key(key: str, other: str, span: Span, owner: str) -> Diagnostic:
    """E0228: two keys of which only one can be given."""
    message = f"{owner} has `{key}` beside `{other}`"
    repair = f"remove `{key}:` or `{other}:`"
    return error("E0228", span, message, "only one of the two", help=repair)


def no_unit_of_time(unit: str, span: Span) -> Diagnostic:
    """E0824: a unit of the time column that is no time."""
    message = f"the time column cannot be in {unit}"
    repair = "units of time are s, ms, us, min, h"
    return error("E0824", span, message, "not a unit of time", help=repair)


def bad_time_format(text: str, reason: str, repair: str | None, span: Span) -> Diagnostic:
    """E0885: a `format:` of dates that has a mistake, or contradicts another key."""
    message = f"the format `{text}` of dates has a mistake: {reason}"
    return error("E0885", span, message, "this is wrong", help=repair)


def unknown_zone(name: str, near: tuple[str, ...] | None, span: Span) -> Diagnostic:
    """E0886: a time zone that is unknown."""
    if near is None:
        repair = "this machine has no database of time zones: run `pip install tzdata`"
    elif near:
        repair = f"did you mean {' or '.join(f'`{zone}`' for zone in near)}?"
    else:
        repair = "zones are named by a city, such as `Europe/Berlin`; or write `UTC`"
    return error("E0886", span, f"`{name}` is no time zone", "unknown", help=repair)


KEYS_ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    "activation_function": ("activation",),
    "batch_size": ("batch",),
    "bounds": ("range",),
    "comment": ("doc",),
    "ddt": ("der",),
    # of several the entry decides: a parameter has `init`, a constant `value`
    "default": ("init", "value"),
    "dense": ("linear",),
    "derivative": ("der",),
    "description": ("doc",),
    "dot": ("der",),
    "dt": ("sample_time",),
    "dxdt": ("der",),
    "early_stopping": ("early_stop",),
    "equation": ("expr",),
    "file": ("source",),
    "files": ("source",),
    "formula": ("expr",),
    "fully_connected": ("linear",),
    "hidden_layers": ("hidden",),
    "hidden_sizes": ("hidden",),
    "init": ("value",),
    "initial": ("init", "value"),
    "initial_value": ("init", "value"),
    "iterations": ("epochs",),
    "kernel_size": ("window",),
    "layers": ("hidden",),
    "learning_rate": ("lr",),
    "lookup": ("interpolation",),
    "lookup_table": ("interpolation",),
    "loss": ("expr", "losses"),
    "lower": ("min",),
    "max_epochs": ("epochs",),
    "n_epochs": ("epochs",),
    "neurons": ("hidden",),
    "nn": ("mlp",),
    "num_epochs": ("epochs",),
    "optim": ("optimizer",),
    "params": ("parameters",),
    "path": ("source",),
    "sampling_time": ("sample_time",),
    "scheduler": ("schedule",),
    # a key of `layers:`, where people look for what other tools call so
    "table": ("interpolation",),
    "taps": ("window",),
    "trainable": ("learn",),
    "ts": ("sample_time",),
    "units": ("unit", "hidden"),
    "upper": ("max",),
    "value": ("init",),
    "variables": ("equations",),
}
"""The first that the section has is meant."""

FORMS_ELSEWHERE: Mapping[str, tuple[str, str]] = {
    # keys of a stage, written into the options of its optimizer: `lr` shows that these are such
    "batch": ("lr", "`batch: …` beside `optimizer:`, in the stage"),
    "bounds": ("min", "`min: …` and `max: …`"),
    "clip": ("lr", "`clip: …` beside `optimizer:`, in the stage"),
    "early_stop": ("lr", "`early_stop: {patience: …}` beside `optimizer:`, in the stage"),
    "epochs": ("lr", "`epochs: …` beside `optimizer:`, in the stage"),
    "limits": ("min", "`min: …` and `max: …`"),
    "patience": ("early_stop", "`early_stop: {patience: …}`"),
    "range": ("min", "`min: …` and `max: …`"),
    "schedule": ("lr", "`schedule: …` beside `optimizer:`, in the stage"),
    "weight_decay": ("lr", "`weight_decay: …` beside `optimizer:`, in the stage"),
}
"""A key that the section must have, and what is written there, where one word is not enough."""
