"""E05xx: units of measurement."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def malformed_unit(problem: str, span: Span, repair: str | None, meant: str | None) -> Diagnostic:
    """E0501: a text that is not a unit."""
    shown = f"write `{repair}`" if repair else None
    return error("E0501", span, problem, "not a unit", help=shown, replacement=meant)


def two_units(written: str, declared: str, span: Span, declaration: Span) -> Diagnostic:
    """E0502: a value with one unit in an entry that declares another."""
    return error(
        "E0502",
        span,
        f"the value is in {written}, but the unit is declared as {declared}",
        written,
        secondary=((declaration, f"declared as {declared} here"),),
        help="write a unit that converts, or the unit once",
    )


def incomparable_unit(written: str, wanted: str, span: Span) -> Diagnostic:
    """E0503: a unit of the wrong dimension."""
    return error("E0503", span, f"{written} is not a unit of {wanted}", f"expected {wanted}")


def turns_or_radians(
    written: str, wanted: str, count: str, turns: str, radians: str, span: Span
) -> Diagnostic:
    """E0507: a conversion between a unit that counts per time and one of angle per time."""
    message = f"{written} is no clear number of {wanted}: {count} may count revolutions or radians"
    repair = f"write `{turns}` in place of `{count}` for revolutions, or `{radians}` for radians"
    return error("E0507", span, message, f"expected {wanted}", help=repair)


def unit_of_none(name: str, written: str, span: Span) -> Diagnostic:
    """E0978: a number with a unit, for a value without a unit."""
    message = f"`{name}` has no unit in which {written} is a number"
    repair = f"give `{name}` its `unit:`, or write the number alone"
    return error("E0978", span, message, "nothing says how to convert it", help=repair)


def units_differ(
    operation: str,
    found: str,
    expected: str,
    span: Span,
    secondary: tuple[tuple[Span, str], ...],
    *,
    bare: str | None,
    factor: float | None,
) -> Diagnostic:
    """W0504: units that do not fit an operation; an error under `--strict-units`."""
    # `bare` is a bare number with the unit that it lacks, `factor` one unit found in the other
    repair = None
    if bare is not None:
        repair = f"a number with a unit is a constant: `constants: {{NAME: {bare}}}`"
    elif factor is not None:
        repair = f"1 {found} is {factor:.6g} {expected}: nothing is converted in formulas"
    message = f"units do not fit in `{operation}`: {found} where {expected} is expected"
    return warning("W0504", span, message, f"{expected} expected", secondary=secondary, help=repair)


def rate_of_another_time(
    state: str, rate: str, factor: str, seconds: float, span: Span, place: Span
) -> Diagnostic:
    """W0509: a state without unit whose derivative has another time unit than the second."""
    message = f"`der` is per second, the rate of `{state}` is in {rate}, and `{state}` has no unit"
    repair = (
        f"divide by a constant of `{seconds:.12g} {factor}` and declare the unit of `{state}`, or "
        "declare the inputs of `der` per second"
    )
    secondary = ((place, "no unit is declared"),)
    return warning(
        "W0509", span, message, f"{rate} taken per second", secondary=secondary, help=repair
    )


def unconverted(
    written: str,
    number: str,
    unit: str,
    coherent: str,
    reason: str,
    span: Span,
    secondary: tuple[tuple[Span, str], ...] = (),
) -> Diagnostic:
    """W0510: a quantity in a multiple of an SI unit, written to something without unit."""
    message = f"{written} is taken as {number}: {reason}"
    repair = (
        f"declare `unit: {coherent}`, to which it converts, or `unit: {unit}` if {number} is meant"
    )
    label = f"not in {coherent}"
    return warning("W0510", span, message, label, secondary=secondary, help=repair)


def strict_units(count: int) -> Diagnostic:
    """E0506: units that do not fit, which `--strict-units` refuses."""
    warnings = "the warning" if count == 1 else f"the {count} warnings"
    message = f"units do not fit, and --strict-units refuses {warnings} about it"
    return error("E0506", None, message)


def declared_unit_differs(
    name: str, found: str, declared: str, span: Span, *, is_temperature: bool = False
) -> Diagnostic:
    """W0505: an expression in another unit than its entry declares."""
    message = f"`{name}` is declared in {declared}, its expression is in {found}"
    repair = None
    if is_temperature:
        repair = "degC - degC is in K, degC + K in degC: declare the unit of the difference or sum"
    return warning("W0505", span, message, f"this is in {found}", help=repair)
