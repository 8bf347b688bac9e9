"""E1117, E1140, E1143, E1144, E1224, W1120: controllers that cannot be exported or compiled."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def no_control(place: Span | None = None) -> Diagnostic:
    """E1140: an export of a controller is requested, but the spec defines none."""
    repair = "add an `mpc:` section, which says what the controller makes small"
    message = "the spec has neither an `mpc` section nor an `estimator` to write in C"
    return error("E1140", place, message, "asked for here", help=repair)


def unsuited_key(key: str, place: Span | None) -> Diagnostic:
    """E1143: an entry of `export` has a key that does not apply to controllers."""
    message = f"`{key}` says nothing of a controller"
    repair = "the `mpc` section says what it controls and what is fed back"
    return error("E1143", place, message, "here", help=repair)


def platforms_without_units(place: Span | None) -> Diagnostic:
    """E1224: `platforms` is given for a controller without `with: fmu`."""
    message = "`platforms` are those of units, and none are written of the controller"
    repair = "add `with: fmu`; C that is compiled by hand needs no platform"
    return error("E1224", place, message, "without `with: fmu`", help=repair)


def variance_of_single(name: str, variance: float, place: Span | None) -> Diagnostic:
    """E1117: a variance of an estimator overflows or underflows in single precision."""
    message = f"`{name}` has a variance of {variance:.2g} in the estimator, beyond single precision"
    repair = f"export `dtype: float64`, or write `{name}` in a unit that suits its size"
    return error("E1117", place, message, "`float32` here", help=repair)


def nothing_compiles(reason: str) -> Diagnostic:
    """E1144: `solver="c"` is requested, but no compiled controller can run here."""
    repair = 'install a C compiler, or leave `solver="c"` out'
    return error("E1144", None, f"no compiled controller can solve here: {reason}", help=repair)


def solved_in_python(reason: str) -> Diagnostic:
    """W1120: the controller is solved in Python, which is much slower than compiled C."""
    message = f"the controller solves in Python, which takes far longer than its C: {reason}"
    return warning("W1120", None, message)
