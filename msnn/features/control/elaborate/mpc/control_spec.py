"""Writes the formulas of an `mpc` section as outputs of the model, so that they are compiled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from compiler.linking.link import Connected, Linked
from compiler.lowering.context import Scope
from msnn.features.control.errors import control as errors
from msnn.features.control.keys.mpc import ControlReference, OptimalControl
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import names
from spec_schema.errors import time as times
from spec_schema.expressions.tree import Expression, Name
from spec_schema.fields.leaf import KeyAndValueSpan
from spec_schema.sections.signals import Input, Output
from spec_schema.sections.spec import Spec
from spec_schema.units.quantity import Quantity

_FORMULA = "mpc: "
"""Prefix of the names of such outputs; no name that a spec declares has a blank."""
STAGE = f"{_FORMULA}cost.stage"
TERMINAL = f"{_FORMULA}cost.terminal"


def bounded(name: str) -> str:
    """The output that is the value of a bounded state, output or equation."""
    return f"{_FORMULA}bounds.{name}"


def limit(name: str, key: str) -> str:
    """The output that is the `min` or the `max` of a bound."""
    return f"{_FORMULA}bounds.{name}.{key}"


@dataclass(frozen=True, kw_only=True)
class ControlSpec:
    """A model with references as further inputs and formulas of `mpc` as further outputs."""

    linked: Linked
    section: OptimalControl
    formulas: tuple[str, ...]
    """The names of those outputs."""
    controls: tuple[str, ...]
    closed: Mapping[str, str]
    """The inputs that are fed back along the horizon, by the outputs that predict them."""


def control_spec(linked: Linked, section: OptimalControl, findings: Findings) -> ControlSpec:
    """The model that computes all formulas of the `mpc` section of a linked spec.

    Reports what of the section does not fit what the spec declares.
    """
    spec = linked.spec
    if spec.sample_time is None:
        findings.report(times.needs_sample_time("`mpc`", section.place.key))
    # only of an input: what predicts a target or a state feeds nothing back
    closed = {
        output.predicts.signal.value: name
        for name, output in spec.outputs.items()
        if output.predicts is not None and output.predicts.signal.value in spec.inputs
    }
    _check_controls(spec, section, closed, findings)
    _check_references(spec, section, findings)
    _check_bounds(spec, section, findings)
    _check_previews(spec, section, closed, findings)
    formulas = dict(_formulas(section))
    outputs = {n: _output(expr) for n, expr in formulas.items()}
    inputs = {name: _input(entry) for name, entry in section.references.items()}
    # pydantic does not validate a copy: what is added was read from the file already
    whole = spec.model_copy(
        update={
            "inputs": {**spec.inputs, **inputs},
            "outputs": {**spec.outputs, **outputs},
            "mpc": None,
        }
    )
    controls = tuple(control.value for control in section.controls)
    return ControlSpec(
        linked=replace(linked, spec=whole),
        section=section,
        formulas=tuple(formulas),
        controls=controls,
        closed=closed,
    )


def _formulas(section: OptimalControl) -> list[tuple[str, Expression]]:
    found = [(STAGE, section.cost.stage)]
    if section.cost.terminal is not None:
        found.append((TERMINAL, section.cost.terminal))
    controls = {control.value for control in section.controls}
    for name, bound in section.bounds.items():
        if name not in controls:
            found.append((bounded(name), Name(name, bound.place.key)))
        # a number becomes an output later, once the compiler knows the unit of what it limits
        for key, value in (("min", bound.min), ("max", bound.max)):
            if value is not None and not isinstance(value, Quantity):
                found.append((limit(name, key), value))
    return found


def _output(expression: Expression) -> Output:
    place = KeyAndValueSpan(expression.span, expression.span)
    return Output.model_construct(place=place, expr=expression)


def _input(entry: ControlReference) -> Input:
    return Input.model_construct(place=entry.place, unit=entry.unit, dims=entry.dims, doc=entry.doc)


def _check_controls(
    spec: Spec, section: OptimalControl, closed: Mapping[str, str], findings: Findings
) -> None:
    for control in section.controls:
        name = control.value
        if name not in spec.inputs:
            found = _kind(spec, name)
            findings.report(errors.not_a_control(name, found, control.span, spec.inputs))
        elif name in closed:
            predicts = spec.outputs[closed[name]].predicts
            assert predicts is not None
            fault = errors.closed_control(name, closed[name], control.span, predicts.span)
            findings.report(fault)


def _check_references(spec: Spec, section: OptimalControl, findings: Findings) -> None:
    # findings of its own: the model has been compiled, and what is wrong with its names was told
    scope = Scope(spec, Findings())
    for name, entry in section.references.items():
        # references become inputs of the asked model, among whose names there is only one of each
        if name in scope:
            first = scope[name]
            place, kind = first.entry.place.key, first.kind.value
            findings.report(names.declared_twice(name, entry.place.key, place, kind))


def _check_bounds(spec: Spec, section: OptimalControl, findings: Findings) -> None:
    controls = {control.value for control in section.controls}
    for name, bound in section.bounds.items():
        kind = _kind(spec, name)
        place = bound.place.key
        if name in controls:
            # a control goes to an actuator: its limits hold whatever the solve does, so neither
            # word fits
            if bound.soft is not None:
                place = bound.soft.place.key
                findings.report(errors.bound_option(name, "soft", "a control", place))
            elif bound.hard:
                findings.report(errors.bound_option(name, "hard", "a control", place))
        elif kind is None:
            known = [*controls, *spec.states, *spec.outputs, *spec.equations]
            reason = "which nothing declares"
            findings.report(errors.not_bounded(name, reason, place, known))
        # an input that is fed back along the horizon moves like a state; `path_limits` refuses
        # others
        elif not any(name in part for part in (*_bounded_sections(spec), spec.inputs)):
            findings.report(errors.not_bounded(name, f"which is {kind}", place, ()))
        elif bound.rate is not None:
            findings.report(errors.bound_option(name, "rate", kind, bound.rate.span))


def _check_previews(
    spec: Spec, section: OptimalControl, closed: Mapping[str, str], findings: Findings
) -> None:
    controls = {control.value for control in section.controls}
    for entry in section.preview:
        name = entry.value
        if name in controls:
            findings.report(errors.needless_preview(name, "a control", entry.span))
        elif name in closed:
            findings.report(errors.needless_preview(name, "fed back", entry.span))
        elif name not in spec.inputs:
            known = _kind(spec, name) or "no input of the model"
            findings.report(errors.needless_preview(name, known, entry.span))


def _bounded_sections(spec: Spec) -> tuple[Mapping[str, object], ...]:
    return spec.states, spec.outputs, spec.equations


def _kind(spec: Spec, name: str) -> str | None:
    """The kind of a name, as messages call it; None if the name is not declared."""
    declared = Scope(spec, Findings()).get(name)
    if declared is None:
        return None
    return "connected" if isinstance(declared.entry, Connected) else declared.kind.value
