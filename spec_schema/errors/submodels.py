"""E0730-E0749: sub-models and what is connected to them."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def unreadable_spec(path: str, reason: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0730: a sub-model whose spec cannot be read."""
    message = f"cannot read the sub-model's spec {path}: {reason}"
    notes = ("a path is relative to the folder of the file that it stands in",)
    return error("E0730", span, message, "used here", notes=notes, help=repair)


def uses_itself(chain: Sequence[str], span: Span) -> Diagnostic:
    """E0731: a spec that is a part of itself."""
    message = f"a spec uses itself: {' → '.join(chain)}"
    return error("E0731", span, message, "leads back to a file that is being read")


def too_many_submodels(limit: str, span: Span) -> Diagnostic:
    """E0732: too many sub-models, or too deep nesting of them."""
    return error("E0732", span, f"more than {limit}", "with this one")


def other_sample_time(name: str, found: str, expected: str, span: Span, place: Span) -> Diagnostic:
    """E0733: a sub-model with another sample time than the spec that uses it."""
    message = f"`{name}` has {found}, the spec that uses it {expected}"
    repair = "train and use it at one sample time"
    return error("E0733", span, message, "used here", secondary=((place, found),), help=repair)


def not_an_input(name: str, kind: str | None, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0734: a connection to something else than an input of a sub-model."""
    # a name that is something else was not misspelt
    meant = nearest(name, known) if kind is None else None
    label = "no such input" if kind is None else f"this is {kind}"
    message = f"`{name}` is not an input of a sub-model"
    repair = did_you_mean(meant)
    return error("E0734", span, message, label, help=repair, replacement=meant)


def fed_twice(name: str, span: Span, first: Span) -> Diagnostic:
    """E0735: an input to which two connections lead."""
    message = f"`{name}` is connected twice"
    label = "connected again here"
    return error("E0735", span, message, label, secondary=((first, "connected here already"),))


def connection_axes(
    name: str, expected: str, found: str, span: Span, declaration: Span
) -> Diagnostic:
    """E0736: an expression with other axes than the input that it is connected to."""
    message = f"`{name}` takes {expected}, its connection is {found}"
    label = f"this is {found}"
    return error(
        "E0736", span, message, label, secondary=((declaration, f"the input is {expected}"),)
    )


def connection_unit(
    name: str, expected: str, found: str, span: Span, declaration: Span
) -> Diagnostic:
    """W0737: an expression in another unit than the input; refused under `--strict-units`."""
    message = f"`{name}` is declared in {expected}, its connection is in {found}"
    label = f"this is in {found}"
    return warning(
        "W0737", span, message, label, secondary=((declaration, f"the input is in {expected}"),)
    )


def log_of_connected(name: str, span: Span, connection: Span) -> Diagnostic:
    """E0738: the recorded value of a connected input, which has no recording."""
    message = f"`{name}` is connected and has no log"
    label = "not logged"
    repair = f"write `{name}` for its value"
    return error(
        "E0738", span, message, label, secondary=((connection, "connected here"),), help=repair
    )


def unknown_submodel_member(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0739: something after the dot that a sub-model does not have."""
    base, _, member = name.rpartition(".")
    meant = nearest(name, known)
    message = f"the sub-model `{base}` has no `{member}`"
    repair = did_you_mean(meant)
    return error("E0739", span, message, "no such member", help=repair, replacement=meant)


def unusable_weights(name: str, problem: str, span: Span, repair: str | None) -> Diagnostic:
    """E0740: a sub-model's weights that cannot be read or do not fit its spec."""
    return error("E0740", span, f"the weights of `{name}`: {problem}", "these", help=repair)


def weights_of_other_text(name: str, spec: str, span: Span) -> Diagnostic:
    """W0742: a sub-model's weights that were trained with another text of its spec."""
    message = f"the weights of `{name}` were trained with another text of {spec}"
    repair = "train it again if more than comments, data or training has changed"
    return warning("W0742", span, message, "written for another version", help=repair)
