"""E02xx: the schema of a spec, its sections, keys and plain values."""

from collections.abc import Iterable

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest
from spec_schema.names import similar_name

# The keys of a layer are worth listing, those of a whole spec are in the documentation.
_SHORT_LIST = 12


def unknown_key(key: str, span: Span, owner: str, known: Iterable[str]) -> Diagnostic:
    """E0201: a key that the language does not have."""
    known = tuple(known)
    meant = nearest(key, known)
    return Diagnostic(
        "E0201",
        "error",
        f"unknown key `{key}` in {owner}",
        span,
        "no such key",
        notes=() if meant else (f"known keys: {', '.join(known)}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def key_not_yet(key: str, span: Span, owner: str, known: Iterable[str]) -> Diagnostic:
    """E0202: a key of the full language that this version does not read."""
    known = tuple(known)
    return Diagnostic(
        "E0202",
        "error",
        f"`{key}` in {owner} is not in this version of msnn",
        span,
        "planned, not available yet",
        notes=(f"available here: {', '.join(known)}",) if len(known) <= _SHORT_LIST else (),
    )


def missing_key(key: str, span: Span, owner: str) -> Diagnostic:
    """E0203: a key that must be there."""
    return Diagnostic(
        "E0203",
        "error",
        f"{owner} needs the key `{key}`",
        span,
        f"`{key}` is missing here",
        help="add `msnn: 1`" if key == "msnn" else f"add `{key}:`",
    )


def wrong_kind(wanted: str, found: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0204: a value of the wrong kind."""
    return Diagnostic(
        "E0204",
        "error",
        f"expected {wanted}, found {found}",
        span,
        f"this is {found}",
        help=repair,
    )


def malformed_name(name: str, span: Span) -> Diagnostic:
    """E0205: a name that expressions could not use."""
    similar = similar_name(name)
    repair = f"write for example `{similar}`" if similar else None
    if name.isdecimal():
        repair = (
            "name a dimension of `dims:`, where its size stands; leave the key out for one number"
        )
    return Diagnostic(
        "E0205",
        "error",
        f"`{name}` is not a name",
        span,
        "a name is made of letters (Latin or Greek), digits and `_`, and starts with a letter",
        help=repair,
    )


def malformed_member(name: str, span: Span) -> Diagnostic:
    """E0229: a key that is to name an input of a sub-model."""
    return Diagnostic(
        "E0229",
        "error",
        f"`{name}` does not name an input of a sub-model",
        span,
        "not a name with a dot",
        help="write the name of the sub-model, a dot and its input: `plant.u: …`",
    )


def reserved_name(name: str, span: Span, reason: str) -> Diagnostic:
    """E0206: a name that means something already."""
    return Diagnostic(
        "E0206",
        "error",
        f"`{name}` cannot be declared: {reason}",
        span,
        "reserved",
        help=f"choose another name, for example `{name}_`",
    )


def unknown_choice(text: str, span: Span, choices: Iterable[str]) -> Diagnostic:
    """E0207: a word that is not one of the choices."""
    choices = tuple(choices)
    meant = nearest(text, choices)
    return Diagnostic(
        "E0207",
        "error",
        f"`{text}` is not one of {', '.join(choices)}",
        span,
        "unknown choice",
        help=f"did you mean `{meant}`?" if meant else None,
    )


def one_variant(owner: str, span: Span, found: Iterable[str], choices: Iterable[str]) -> Diagnostic:
    """E0209: none or several where exactly one variant is wanted."""
    found = tuple(found)
    said = f"has {' and '.join(found)}" if found else "has none"
    return Diagnostic(
        "E0209",
        "error",
        f"{owner} takes exactly one of {', '.join(choices)}; this one {said}",
        span,
        "choose one",
    )


def out_of_range(text: str, span: Span, wanted: str) -> Diagnostic:
    """E0210: a number outside what the key allows."""
    return Diagnostic("E0210", "error", f"`{text}` is out of range", span, f"must be {wanted}")


def old_boolean(text: str, span: Span) -> Diagnostic:
    """E0211: yes, no, on, off, which were booleans in YAML 1.1."""
    meant = "true" if text.lower() in {"yes", "on", "y"} else "false"
    return Diagnostic(
        "E0211",
        "error",
        f"`{text}` is text, not true or false",
        span,
        "text in YAML 1.2",
        help=f"write `{meant}`",
    )


def empty_value(wanted: str, span: Span) -> Diagnostic:
    """E0212: a key with nothing after it."""
    return Diagnostic("E0212", "error", f"expected {wanted}, found nothing", span, "empty")


def unknown_language(text: str, span: Span) -> Diagnostic:
    """E0214: a spec of another language version."""
    return Diagnostic(
        "E0214",
        "error",
        f"`msnn: {text}` is not a language version this msnn reads",
        span,
        "unknown version",
        help="write `msnn: 1`",
    )


def empty_section(owner: str, span: Span) -> Diagnostic:
    """E0215: a section that must hold something."""
    return Diagnostic("E0215", "error", f"{owner} must not be empty", span, "nothing in it")


def malformed_length(text: str, span: Span) -> Diagnostic:
    """E0216: neither samples nor a duration."""
    return Diagnostic(
        "E0216",
        "error",
        f"`{text}` is not a length of time",
        span,
        "not a length",
        notes=("the units of a duration are us, ms, s, min and h",),
        help="write a number of samples such as `5`, or a duration such as `50 ms`",
    )


def malformed_sample_time(text: str, span: Span) -> Diagnostic:
    """E0217: a sample time that is neither a time nor a frequency."""
    return Diagnostic(
        "E0217",
        "error",
        f"`{text}` is not a sample time",
        span,
        "write a positive time such as `50 ms`, or a frequency such as `20 Hz`",
        help=f"in seconds it is `{text} s`" if text.replace(".", "", 1).isdigit() else None,
    )


def malformed_quantity(text: str, span: Span) -> Diagnostic:
    """E0218: neither a number nor a number with a unit."""
    return Diagnostic(
        "E0218",
        "error",
        f"`{text}` is not a quantity",
        span,
        "write a number, or a number and a unit such as `2 mm`",
    )


def malformed_prediction(span: Span) -> Diagnostic:
    """E0219: `predicts` with something else than a sample of a signal."""
    return Diagnostic(
        "E0219",
        "error",
        "`predicts` names one sample of a logged signal",
        span,
        "not a signal at t or later",
        help="write for example `predicts: x[t+1]`",
    )


def list_for_expression(span: Span) -> Diagnostic:
    """E0221: YAML read a list or mapping where an expression was meant."""
    return Diagnostic(
        "E0221",
        "error",
        "expected an expression, found a YAML list or mapping",
        span,
        "YAML reads brackets at the start of a value as its own",
        help="put the whole expression in quotes",
    )


def malformed_columns(text: str, span: Span) -> Diagnostic:
    """E0222: a column pattern that cannot be expanded."""
    return Diagnostic(
        "E0222",
        "error",
        f"`{text}` is not a column pattern",
        span,
        "a pattern has one ascending range, as in `tau{1..6}`",
    )


def misfitting_split(problem: str, span: Span) -> Diagnostic:
    """E0223: a split whose keys do not fit each other."""
    return Diagnostic("E0223", "error", problem, span, "does not fit")


def reversed_range(low: str, high: str, span: Span) -> Diagnostic:
    """E0224: a range whose ends are in the wrong order."""
    return Diagnostic(
        "E0224", "error", f"the range [{low}, {high}] is empty", span, "low must be below high"
    )


def repeated_item(text: str, span: Span, first: Span) -> Diagnostic:
    """E0225: an item twice in a list of different things."""
    return Diagnostic(
        "E0225",
        "error",
        f"`{text}` stands twice in this list",
        span,
        "again here",
        secondary=((first, "first here"),),
    )


def excluded_key(key: str, other: str, span: Span, owner: str) -> Diagnostic:
    """E0228: two keys of which only one can be given."""
    return Diagnostic(
        "E0228",
        "error",
        f"{owner} has `{key}` beside `{other}`",
        span,
        "only one of the two",
        help=f"remove `{key}:` or `{other}:`",
    )


def no_unit_of_time(unit: str, span: Span) -> Diagnostic:
    """E0824: a unit of the time column that is no time."""
    return Diagnostic(
        "E0824",
        "error",
        f"the time column cannot be in {unit}",
        span,
        "not a unit of time",
        help="units of time are s, ms, us, min, h",
    )
