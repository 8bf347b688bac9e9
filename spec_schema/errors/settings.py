"""E1030-E1032: settings such as `train.0.epochs=5` of the command line."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


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


def unsettable(path: str, sections: Sequence[str], span: Span) -> Diagnostic:
    """E1031: a `--set` of something that is not a key of the workflow."""
    listed = ", ".join(f"`{section}.…`" for section in sections)
    return Diagnostic(
        "E1031",
        "error",
        f"`{path}` cannot be set from the command line",
        span,
        "not part of the workflow",
        help=f"{listed} can be set; change the spec for anything else",
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
