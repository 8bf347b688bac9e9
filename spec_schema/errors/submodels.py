"""E0730-E0749: sub-models and what is connected to them."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def unreadable_spec(path: str, reason: str, span: Span) -> Diagnostic:
    """E0730: a sub-model whose spec cannot be read."""
    return Diagnostic(
        "E0730",
        "error",
        f"cannot read the sub-model's spec {path}: {reason}",
        span,
        "used here",
        notes=("a path is relative to the folder of the file that it stands in",),
    )


def uses_itself(chain: Sequence[str], span: Span) -> Diagnostic:
    """E0731: a spec that is a part of itself."""
    return Diagnostic(
        "E0731",
        "error",
        f"a spec uses itself: {' → '.join(chain)}",
        span,
        "leads back to a file that is being read",
    )


def too_many_submodels(limit: str, span: Span) -> Diagnostic:
    """E0732: more sub-models, or a deeper nesting of them, than anybody means."""
    return Diagnostic("E0732", "error", f"more than {limit}", span, "with this one")


def other_sample_time(name: str, found: str, expected: str, span: Span, place: Span) -> Diagnostic:
    """E0733: a sub-model with another sample time than the spec that uses it."""
    return Diagnostic(
        "E0733",
        "error",
        f"`{name}` has {found}, the spec that uses it {expected}",
        span,
        "used here",
        secondary=((place, found),),
        help="train and use it at one sample time",
    )


def not_an_input(name: str, kind: str | None, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0734: a connection to something else than an input of a sub-model."""
    meant = nearest(name, known) if kind is None else None
    label = "no such input" if kind is None else f"this is {kind}"
    return Diagnostic(
        "E0734",
        "error",
        f"`{name}` is not an input of a sub-model",
        span,
        label,
        help=f"did you mean `{meant}`?" if meant else None,
    )


def fed_twice(name: str, span: Span, first: Span) -> Diagnostic:
    """E0735: an input that two connections feed."""
    return Diagnostic(
        "E0735",
        "error",
        f"`{name}` is connected twice",
        span,
        "connected again here",
        secondary=((first, "connected here already"),),
    )


def connection_axes(
    name: str, expected: str, found: str, span: Span, declaration: Span
) -> Diagnostic:
    """E0736: an expression with other axes than the input that it is connected to."""
    return Diagnostic(
        "E0736",
        "error",
        f"`{name}` takes {expected}, its connection is {found}",
        span,
        f"this is {found}",
        secondary=((declaration, f"the input is {expected}"),),
    )


def connection_unit(
    name: str, expected: str, found: str, span: Span, declaration: Span
) -> Diagnostic:
    """W0737: an expression in another unit than the input; refused under `--strict-units`."""
    return Diagnostic(
        "W0737",
        "warning",
        f"`{name}` is declared in {expected}, its connection is in {found}",
        span,
        f"this is in {found}",
        secondary=((declaration, f"the input is in {expected}"),),
    )


def log_of_connected(name: str, span: Span, connection: Span) -> Diagnostic:
    """E0738: the log of an input that is connected, and so not logged."""
    return Diagnostic(
        "E0738",
        "error",
        f"`{name}` is connected and has no log",
        span,
        "not logged",
        secondary=((connection, "connected here"),),
        help=f"write `{name}` for its value",
    )


def unknown_submodel_member(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0739: something after the dot that a sub-model does not have."""
    base, _, member = name.rpartition(".")
    meant = nearest(name, known)
    return Diagnostic(
        "E0739",
        "error",
        f"the sub-model `{base}` has no `{member}`",
        span,
        "no such member",
        help=f"did you mean `{meant}`?" if meant else None,
    )


def unusable_weights(name: str, problem: str, span: Span, repair: str | None) -> Diagnostic:
    """E0740: a sub-model's weights that cannot be read or do not fit its spec."""
    return Diagnostic(
        "E0740", "error", f"the weights of `{name}`: {problem}", span, "these", help=repair
    )


def weights_of_other_text(name: str, spec: str, span: Span) -> Diagnostic:
    """W0742: a sub-model's weights that were trained with another text of its spec."""
    return Diagnostic(
        "W0742",
        "warning",
        f"the weights of `{name}` were trained with another text of {spec}",
        span,
        "written for another version",
        help="train it again if more than comments, data or training has changed",
    )
