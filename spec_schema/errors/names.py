"""E0301-E0319, E0349, E0350: names, and what a name is used for."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def unknown_name(
    name: str,
    span: Span,
    known: Iterable[str],
    wanted: str = "an input, parameter, layer or equation",
    meant: str | None = None,
    *,
    repair: str | None = None,
    otherwise: str | None = None,
) -> Diagnostic:
    """E0301: a name that nothing declares."""
    message = f"unknown name `{name}`"
    # `np.pi`: what is meant is known, whatever `np` is near to
    if repair is not None:
        return error("E0301", span, message, f"not {wanted}", help=repair)
    # the caller's guess first: it knows of habits from other languages, distance knows letters only
    meant = meant or nearest(name, known)
    help = did_you_mean(meant) or otherwise
    return error("E0301", span, message, f"not {wanted}", help=help, replacement=meant)


def declared_twice(name: str, span: Span, first: Span, kind: str) -> Diagnostic:
    """E0302: one name for two things."""
    message = f"`{name}` is declared twice"
    # the second place is underlined: whoever writes from top to bottom has just typed that one
    label = "again here"
    repair = "all sections of a spec share one namespace"
    return error(
        "E0302", span, message, label, secondary=((first, f"already {kind} here"),), help=repair
    )


def not_a_value(name: str, kind: str, span: Span) -> Diagnostic:
    """E0303: a layer, function or dimension used as a value."""
    called = kind in {"a layer", "a function", "a builtin"}
    message = f"`{name}` is {kind}, not a value"
    repair = f"call it: `{name}(…)`" if called else None
    return error("E0303", span, message, "a value is needed here", help=repair)


def not_callable(name: str, kind: str, span: Span, moves: bool = False) -> Diagnostic:
    """E0304: a value that is called like a function."""
    # `moves`: it has another value each sample, so that one of its samples may be meant
    message = f"`{name}` is {kind} and cannot be called"
    repair = "write `*` to multiply"
    if moves:
        repair = f"one sample is `{name}[t-1]`, in square brackets; to multiply write `*`"
    return error("E0304", span, message, "not a layer or function", help=repair)


def wrong_argument_count(
    name: str, wanted: str, found: int, span: Span, keywords: Sequence[str] = ()
) -> Diagnostic:
    """E0305: too few or too many arguments; `keywords` are what it takes by name besides."""
    named = ", ".join(f"`{keyword}=`" for keyword in keywords)
    repair = f"it takes {named} by name" if keywords else None
    return error("E0305", span, f"`{name}` takes {wanted}, not {found}", "this call", help=repair)


def unknown_keyword(name: str, keyword: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E0306: a keyword argument that the function does not have."""
    # read twice below, and the caller may have given a generator
    known = tuple(known)
    takes = (
        f"it takes {', '.join(f'`{word}`' for word in known)}" if known else "it takes no keywords"
    )
    message = f"`{name}` has no argument `{keyword}`"
    repair = did_you_mean(nearest(keyword, known)) or takes
    return error("E0306", span, message, "unknown keyword", help=repair)


def no_member(base: str, member: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0307: something after the dot that the thing before it does not have."""
    windows = "the log of a signal or state is `.meas`, its windows are `.past(…)`, `.future(…)`"
    message = f"`{base}` has no member `{member}`"
    return error("E0307", span, message, "unknown member", help=repair or windows)


def no_value_of_layer(
    layer: str,
    member: str,
    span: Span,
    *,
    arrays: Sequence[str],
    values: Iterable[str],
    members: Iterable[str],
    in_loss: bool,
) -> Diagnostic:
    """E0350: a member of a layer that is not a value."""
    # arrays of weights are values in losses alone: elsewhere they would tie two layers unseen
    known = [*values, *(arrays if in_loss else ())]
    message, label = f"the layer `{layer}` has no member `{member}`", "unknown member"
    if member in members:
        message, label = (
            f"`{layer}.{member}` is called, it is not a value",
            "a value is needed here",
        )
        repair = f"call it: `{layer}.{member}(…)`"
    elif member in arrays:
        message, label = f"`{layer}.{member}` can be read in `losses:` only", "not here"
        repair = (
            "what expressions share with a layer is a parameter of the spec: "
            "`fir` and `linear` take one as their `weight:`"
        )
    elif known:
        repair = did_you_mean(nearest(member, known)) or f"it has `.{'`, `.'.join(known)}`"
    elif in_loss:
        repair = f"`{layer}` has learned no arrays"
    else:
        repair = f"call the layer: `{layer}(…)`"
    return error("E0350", span, message, label, help=repair)


def member_of_grid(grid: str, member: str, inner: Sequence[str], span: Span) -> Diagnostic:
    """E0349: the centres of a grid of fuzzy sets."""
    layers = " and ".join(f"`{name}`" for name in inner)
    message = f"`{grid}` is a grid of {layers}: it has no `.{member}`"
    # `centers` is a value, `offset` takes what the set is evaluated at
    arguments = "(…)" if member == "offset" else ""
    repair = f"take that of each: {', '.join(f'`{name}.{member}{arguments}`' for name in inner)}"
    return error("E0349", span, message, "a grid has no centres of its own", help=repair)


def no_layer_member(
    layer: str, member: str, span: Span, members: Iterable[str], values: Iterable[str]
) -> Diagnostic:
    """E0319: something after the dot that a layer of this kind does not have."""
    known = tuple(members)
    repair = f"it has `.{'`, `.'.join(known)}`" if known else f"call the layer: `{layer}(…)`"
    if member in values:
        repair = f"it is a value, not called: `{layer}.{member}`"
    message = f"the layer `{layer}` has no `.{member}(…)`"
    return error("E0319", span, message, "no member of this kind of layer", help=repair)


def constant_needed(what: str, span: Span) -> Diagnostic:
    """E0309: a value that is only known at run time, where a constant is needed."""
    message = f"{what} must be known when the spec is compiled"
    return error("E0309", span, message, "depends on data, a state or a parameter")


def misplaced(name: str, where: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0310: an item that is not allowed in this part of a spec."""
    return error("E0310", span, f"`{name}` is not allowed in {where}", "not here", help=repair)


def recursive_function(name: str, span: Span) -> Diagnostic:
    """E0311: a function that calls itself."""
    message = f"the function `{name}` calls itself"
    return error("E0311", span, message, "functions are inlined, so they cannot recurse")


def circular_constant(circle: tuple[str, ...], span: Span) -> Diagnostic:
    """E0315: a constant that depends on itself."""
    message = f"the constant `{circle[0]}` needs its own value"
    return error("E0315", span, message, " → ".join(circle))


def unused_entry(name: str, kind: str, span: Span) -> Diagnostic:
    """W0301: a declared name that nothing uses."""
    message = f"`{name}` is never used"
    return warning("W0301", span, message, f"{kind} that no output, state or loss needs")


def unfit_constant(name: str, problem: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0312: a constant or initial value whose numbers do not fit what is declared."""
    return error("E0312", span, f"the value of {name} {problem}", "this value", help=repair)


def unfit_setting(
    owner: str,
    problem: str,
    span: Span,
    repair: str | None = None,
    label: str = "this setting",
) -> Diagnostic:
    """E0313: an option of a layer whose value cannot be used."""
    return error("E0313", span, f"{owner}: {problem}", label, help=repair)


def unusable_numbers(path: str, reason: str, span: Span) -> Diagnostic:
    """E0314: a file of initial values that cannot be used."""
    message = f"cannot take initial values from {path}: {reason}"
    repair = "it is a text of numbers, one row a line, and its path is relative to the spec's"
    return error("E0314", span, message, "this file", help=repair)


def never_finite(span: Span) -> Diagnostic:
    """W0302: a part of a formula that is infinite or NaN for any data."""
    message = "this is infinite or not a number, whatever the data"
    return warning("W0302", span, message, "never finite")


def no_parameter(pattern: str, span: Span, names: Sequence[str]) -> Diagnostic:
    """E0908: a pattern that matches no parameter."""
    meant = nearest(pattern, names)
    message = f"`{pattern}` fits no learnable parameter"
    notes = (f"parameters: {', '.join(names) or 'none'}",)
    repair = did_you_mean(meant)
    return error(
        "E0908", span, message, "no such parameter", notes=notes, help=repair, replacement=meant
    )
