"""E0996, E1030-E1032: settings such as `train.0.epochs=5` of the command line."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def malformed_setting(text: str, span: Span) -> Diagnostic:
    """E1030: a `--set` that is not `path=value`."""
    return Diagnostic(
        "E1030",
        "error",
        f"`--set {text}` is not a path, `=` and a value",
        span,
        "not a setting",
        help="an example: `--set train.0.epochs=5`",
    )


def unsettable(
    path: str, added: Sequence[str], removed: Sequence[str], known: Sequence[str], span: Span
) -> Diagnostic:
    """E1031: a `--set` that would add or remove names of the model."""
    verb, names = ("add", added) if added else ("remove", removed)
    listed = ", ".join(f"`{name}`" for name in names)
    meant = nearest(names[0], known) if added else None
    return Diagnostic(
        "E1031",
        "error",
        f"`{path}` cannot be set: it would {verb} {listed}",
        span,
        "values can be replaced, names are those of the spec",
        notes=(f"names there: {', '.join(known) or 'none'}",),
        help=f"did you mean `{meant}`?" if meant else "change the spec for other names",
    )


def compiled_already(path: str, span: Span) -> Diagnostic:
    """E0996: a `--set` of a value of the model, of a program that is compiled."""
    return Diagnostic(
        "E0996",
        "error",
        f"`{path}` cannot be set: the program file was compiled with the value it had",
        span,
        "a value of the model",
        help="set it for the spec: `msnn compile SPEC --set …`, or any verb with the spec",
    )


def no_such_item(step: str, count: int, span: Span) -> Diagnostic:
    """E1032: a `--set` path that names an item which a list does not have."""
    known = f"0 … {count - 1}" if count else "none"
    return Diagnostic(
        "E1032",
        "error",
        f"`{step}` is no item of the list: its items are numbered from 0 ({known})",
        span,
        "no such item",
    )
