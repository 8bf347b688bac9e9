"""W0807 and W0808: starts of runs that are found by least squares."""

from __future__ import annotations

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, warning


def undecided_start(states: Sequence[str], wanted_by: str, place: str, count: int) -> Diagnostic:
    """W0807: a start of a run that its first evaluations do not decide."""
    message = (
        f"{wanted_by}: the first evaluations do not decide where {_listed(states)} starts, "
        f"from {place}{_more(count)}"
    )
    repair = "what is not decided stays at `from:`; take a longer `over:`, or another `init:`"
    return warning("W0807", None, message, help=repair)


def unsettled_start(states: Sequence[str], wanted_by: str, place: str, count: int) -> Diagnostic:
    """W0808: a search for the start of a run that has not come to its end."""
    message = (
        f"{wanted_by}: the search for where {_listed(states)} starts has not converged, "
        f"from {place}{_more(count)}"
    )
    repair = "begin nearer, by `from:`, or take a shorter `over:`"
    return warning("W0808", None, message, help=repair)


def _listed(states: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in states)


def _more(count: int) -> str:
    return f" and {count - 1} other starts" if count > 1 else ""
