"""Entries of a spec that nothing uses: their own mistakes, and that they are not used."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from compiler.lowering.environment import Environment, Part
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.scope import Kind, owner_of
from spec_schema.errors import names

if TYPE_CHECKING:
    from compiler.lowering.model import Model

_STEP = Environment(Part.STEP)
_EXPECTED_IN_USE = frozenset(
    {Kind.INPUT, Kind.CONSTANT, Kind.PARAMETER, Kind.LAYER, Kind.FUNCTION, Kind.EQUATION}
)


def lower_unused(model: Model) -> None:
    """Lowers the equations that nothing needs, so that their mistakes are found too."""
    for name, entry in model.spec.equations.items():
        with suppress(LoweringFailed):
            model.entries.value(name, entry, _STEP, entry.place.key)


def report_unused(model: Model) -> None:
    """Warns of what a spec declares and nothing refers to."""
    for name, declared in model.scope.items():
        # what a sub-model does not need here, what stays behind may
        expected = declared.kind in _EXPECTED_IN_USE and not owner_of(name)
        if expected and name not in model.used:
            place = declared.entry.place.key
            model.findings.report(names.unused_entry(name, declared.kind.value, place))
