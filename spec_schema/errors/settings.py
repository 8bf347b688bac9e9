"""E0996, E1030-E1032: settings such as `train.0.epochs=5` of the command line."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def malformed_setting(text: str, span: Span) -> Diagnostic:
    """E1030: a `--set` that is not `path=value`."""
    message = f"`--set {text}` is not a path, `=` and a value"
    repair = "an example: `--set train.0.epochs=5`"
    return error("E1030", span, message, "not a setting", help=repair)


def unsettable(
    path: str, added: Sequence[str], removed: Sequence[str], known: Sequence[str], span: Span
) -> Diagnostic:
    """E1031: a `--set` that would add or remove names of the model."""
    verb, names = ("add", added) if added else ("remove", removed)
    listed = ", ".join(f"`{name}`" for name in names)
    meant = nearest(names[0], known) if added else None
    message = f"`{path}` cannot be set: it would {verb} {listed}"
    label = "values can be replaced, names are those of the spec"
    notes = (f"names there: {', '.join(known) or 'none'}",)
    repair = did_you_mean(meant) or "change the spec for other names"
    return error("E1031", span, message, label, notes=notes, help=repair)


def compiled_already(path: str, span: Span) -> Diagnostic:
    """E0996: a `--set` of a value of the model, of a program that is compiled."""
    message = f"`{path}` cannot be set: the program file was compiled with the value it had"
    repair = "set it for the spec: `msnn compile SPEC --set …`, or any verb with the spec"
    return error("E0996", span, message, "a value of the model", help=repair)


def no_such_item(step: str, count: int, span: Span) -> Diagnostic:
    """E1032: a `--set` path that names an item which a list does not have."""
    known = f"0 … {count - 1}" if count else "none"
    message = f"`{step}` is no item of the list: its items are numbered from 0 ({known})"
    return error("E1032", span, message, "no such item")
