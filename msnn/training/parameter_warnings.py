"""Warns of learned parameters that are at a bound or that the data do not determine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.second_order import not_identifiable
from msnn.errors.training import at_bound
from msnn.training.records.standard_errors import StandardErrors
from msnn.training.records.standard_errors import at_bound as is_at_bound
from spec_schema.diagnostics.diagnostic import Diagnostic


def parameter_warnings(
    program: Program, weights: Mapping[str, FloatArray], found: StandardErrors | None
) -> list[Diagnostic]:
    """A warning for every learned parameter at a bound, and for what the data do not determine.

    What the standard errors themselves say comes first.
    """
    warnings = [] if found is None else list(found.notes)
    warnings += [
        at_bound(parameter.name, parameter.span)
        for parameter in program.parameters
        if parameter.learn and is_at_bound(parameter, weights[parameter.name]).any()
    ]
    for changes in [] if found is None else _together(found.unidentified):
        numbers = Counter(_owner(name) for name in {name for change in changes for name in change})
        concerned = {
            p.name: (numbers[p.name], weights[p.name].size)
            for p in program.parameters
            if numbers[p.name]
        }
        first = program.parameter(next(iter(concerned)))
        warnings.append(not_identifiable(changes, concerned, first.span))
    return warnings


def _owner(number: str) -> str:
    """The parameter that a number belongs to."""
    return number.partition("[")[0]


def _together(changes: Sequence[Mapping[str, float]]) -> list[list[Mapping[str, float]]]:
    """The changes in groups that have no parameter in common."""
    groups: list[tuple[set[str], list[Mapping[str, float]]]] = []
    for change in changes:
        owners, members = {_owner(name) for name in change}, [change]
        apart: list[tuple[set[str], list[Mapping[str, float]]]] = []
        for group in groups:
            if group[0] & owners:
                owners, members = owners | group[0], group[1] + members
            else:
                apart.append(group)
        groups = [*apart, (owners, members)]
    return [members for _, members in groups]
