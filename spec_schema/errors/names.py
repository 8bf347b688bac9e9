"""E0301-E0319: names, and what a name is used for."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def unknown_name(
    name: str,
    span: Span,
    known: Iterable[str],
    wanted: str = "an input, parameter, layer or equation",
    meant: str | None = None,
) -> Diagnostic:
    """E0301: a name that nothing declares."""
    meant = meant or nearest(name, known)
    return Diagnostic(
        "E0301",
        "error",
        f"unknown name `{name}`",
        span,
        f"not {wanted}",
        help=f"did you mean `{meant}`?" if meant else None,
    )


def declared_twice(name: str, span: Span, first: Span, kind: str) -> Diagnostic:
    """E0302: one name for two things."""
    return Diagnostic(
        "E0302",
        "error",
        f"`{name}` is declared twice",
        span,
        "again here",
        secondary=((first, f"already {kind} here"),),
        help="all sections of a spec share one namespace",
    )


def not_a_value(name: str, kind: str, span: Span) -> Diagnostic:
    """E0303: a layer, function or dimension where a value is needed."""
    called = kind in {"a layer", "a function", "a builtin"}
    return Diagnostic(
        "E0303",
        "error",
        f"`{name}` is {kind}, not a value",
        span,
        "a value is needed here",
        help=f"call it: `{name}(…)`" if called else None,
    )


def not_callable(name: str, kind: str, span: Span) -> Diagnostic:
    """E0304: a value that is called."""
    return Diagnostic(
        "E0304",
        "error",
        f"`{name}` is {kind} and cannot be called",
        span,
        "not a layer or function",
        help="write `*` to multiply",
    )


def wrong_argument_count(name: str, wanted: str, found: int, span: Span) -> Diagnostic:
    """E0305: too few or too many arguments."""
    return Diagnostic("E0305", "error", f"`{name}` takes {wanted}, not {found}", span, "this call")


def unknown_keyword(name: str, keyword: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0306: a keyword argument that the function does not have."""
    known = tuple(known)
    meant = nearest(keyword, known)
    if meant:
        repair = f"did you mean `{meant}`?"
    else:
        repair = f"it takes {', '.join(known)}" if known else "it takes no keywords"
    return Diagnostic(
        "E0306",
        "error",
        f"`{name}` has no argument `{keyword}`",
        span,
        "unknown keyword",
        help=repair,
    )


def no_member(base: str, member: str, span: Span, function: str | None = None) -> Diagnostic:
    """E0307: something after the dot that the thing before it does not have."""
    # `function` is one of the language, where it is meant: `np.tanh`
    windows = "the log of a signal or state is `.meas`, its windows are `.past(…)`, `.future(…)`"
    repair = f"write `{function}(…)`: functions of the language stand without a prefix"
    return Diagnostic(
        "E0307",
        "error",
        f"`{base}` has no member `{member}`",
        span,
        "unknown member",
        help=repair if function else windows,
    )


def no_layer_member(layer: str, member: str, span: Span, members: Iterable[str]) -> Diagnostic:
    """E0319: something after the dot that a layer of this kind does not have."""
    known = tuple(members)
    repair = f"it has `.{'`, `.'.join(known)}`" if known else f"call the layer: `{layer}(…)`"
    return Diagnostic(
        "E0319",
        "error",
        f"the layer `{layer}` has no `.{member}(…)`",
        span,
        "no member of this kind of layer",
        help=repair,
    )


def constant_needed(what: str, span: Span) -> Diagnostic:
    """E0309: something only known at run time where a number is needed at compile time."""
    return Diagnostic(
        "E0309",
        "error",
        f"{what} must be known when the spec is compiled",
        span,
        "depends on data, a state or a parameter",
    )


def misplaced(name: str, where: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0310: something that is not allowed in this part of a spec."""
    return Diagnostic(
        "E0310", "error", f"`{name}` is not allowed in {where}", span, "not here", help=repair
    )


def recursive_function(name: str, span: Span) -> Diagnostic:
    """E0311: a function that calls itself."""
    return Diagnostic(
        "E0311",
        "error",
        f"the function `{name}` calls itself",
        span,
        "functions are inlined, so they cannot recurse",
    )


def circular_constant(circle: tuple[str, ...], span: Span) -> Diagnostic:
    """E0315: a constant whose value needs itself."""
    return Diagnostic(
        "E0315",
        "error",
        f"the constant `{circle[0]}` needs its own value",
        span,
        " → ".join(circle),
    )


def unused_entry(name: str, kind: str, span: Span) -> Diagnostic:
    """W0301: something declared that nothing uses."""
    return Diagnostic(
        "W0301",
        "warning",
        f"`{name}` is never used",
        span,
        f"{kind} that no output, state or loss needs",
    )


def unfit_constant(name: str, problem: str, span: Span) -> Diagnostic:
    """E0312: a constant or initial value whose numbers do not fit what is declared."""
    return Diagnostic("E0312", "error", f"the value of {name} {problem}", span, "this value")


def unfit_setting(
    owner: str,
    problem: str,
    span: Span,
    repair: str | None = None,
    label: str = "this setting",
) -> Diagnostic:
    """E0313: an option of a layer whose value cannot be used."""
    return Diagnostic("E0313", "error", f"{owner}: {problem}", span, label, help=repair)


def unusable_numbers(path: str, reason: str, span: Span) -> Diagnostic:
    """E0314: a file of initial values that cannot be used."""
    return Diagnostic(
        "E0314",
        "error",
        f"cannot take initial values from {path}: {reason}",
        span,
        "this file",
        help="it is a text of numbers, one row a line, and its path is relative to the spec's",
    )


def never_finite(span: Span) -> Diagnostic:
    """W0302: a part of a formula that is infinite or NaN whatever the data."""
    return Diagnostic(
        "W0302",
        "warning",
        "this is infinite or not a number, whatever the data",
        span,
        "never finite",
    )


def no_parameter(pattern: str, span: Span, names: Sequence[str]) -> Diagnostic:
    """E0908: a pattern of parameter names that fits none."""
    meant = nearest(pattern, names)
    return Diagnostic(
        "E0908",
        "error",
        f"`{pattern}` fits no learnable parameter",
        span,
        "no such parameter",
        notes=(f"parameters: {', '.join(names) or 'none'}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )
