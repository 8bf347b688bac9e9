"""Collects the recorded signals: inputs, targets, and logs of states that are read."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.ir.program import Role, Signal
from compiler.lowering.context import Context
from compiler.lowering.scope import owner_of
from spec_schema.expressions.tree import Member, Name, Window
from spec_schema.sections.signals import Signal as SignalEntry
from spec_schema.sections.spec import Spec


def logged_signals(
    context: Context, ranges: Mapping[str, tuple[float, float]]
) -> tuple[Signal, ...]:
    """The inputs and targets of a lowered spec, and the states whose logs are read."""
    declared = [
        *((Role.INPUT, name, entry) for name, entry in context.spec.inputs.items()),
        *((Role.TARGET, name, entry) for name, entry in _targets(context)),
        *((Role.TARGET, name, entry) for name, entry in context.measured.items()),
    ]
    return tuple(
        Signal(
            name=name,
            role=role,
            axes=context.axes_of(entry),
            unit=entry.unit.value if entry.unit else None,
            range=ranges.get(name),
            on_invalid=entry.on_invalid if isinstance(entry, SignalEntry) else "flag",
            doc=entry.doc or "",
            span=entry.place.key,
        )
        for role, name, entry in declared
    )


def measured_targets(spec: Spec) -> set[str]:
    """The signals that `validate` entries name under `target:`: inputs, targets or logs of
    states.
    """
    names: set[str] = set()
    for check in spec.checks:
        operand = check.target.operand if isinstance(check.target, Window) else check.target
        match operand:
            case Name(name=name):
                names.add(name)
            case Member(base=base, name=name):
                # an entry of a sub-model, or `x.meas`, the log of a state
                names |= {f"{base}.{name}", base}
            case _:
                pass
    return names


def _targets(context: Context) -> list[tuple[str, SignalEntry]]:
    """The targets; those of sub-models only if something reads them (R11)."""
    return [
        (name, entry)
        for name, entry in context.spec.targets.items()
        if not owner_of(name) or name in context.used
    ]
