"""E1117, E1140, E1143, E1144, E1224, W1120: controllers that cannot be exported or compiled."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def no_control(place: Span | None = None) -> Diagnostic:
    """E1140: a controller of a spec that says nothing of one."""
    repair = "add an `mpc:` section, which says what the controller makes small"
    message = "the spec has neither an `mpc` section nor an `estimator` to write in C"
    return error("E1140", place, message, "asked for here", help=repair)


def unsuited_key(key: str, place: Span | None) -> Diagnostic:
    """E1143: a key of other targets in the entry of controllers."""
    message = f"`{key}` says nothing of a controller"
    repair = "the `mpc` section says what it controls and what is fed back"
    return error("E1143", place, message, "here", help=repair)


def platforms_without_units(place: Span | None) -> Diagnostic:
    """E1224: kinds of machines for units of a controller that are not written."""
    message = "`platforms` are those of units, and none are written of the controller"
    repair = "add `with: fmu`; C that is compiled by hand needs no platform"
    return error("E1224", place, message, "without `with: fmu`", help=repair)


def variance_of_single(name: str, variance: float, place: Span | None) -> Diagnostic:
    """E1117: a variance that single precision takes for infinite, or for 0."""
    message = f"`{name}` has a variance of {variance:.2g} in the estimator, beyond single precision"
    repair = f"export `dtype: float64`, or write `{name}` in a unit that suits its size"
    return error("E1117", place, message, "`float32` here", help=repair)


def nothing_compiles(reason: str) -> Diagnostic:
    """E1144: C asked for to solve by, where there is none."""
    repair = 'install a C compiler, or leave `solver="c"` out'
    return error("E1144", None, f"no compiled controller can solve here: {reason}", help=repair)


def solved_in_python(reason: str) -> Diagnostic:
    """W1120: solves that C would do in a fraction of the time."""
    message = f"the controller solves in Python, which takes far longer than its C: {reason}"
    return warning("W1120", None, message)
