"""Describes each export for its user: ports, and omitted slices of learned arrays."""

from __future__ import annotations

from collections.abc import Sequence

from backends.ports.step_interface import Port, step_interface
from compiler.ir.program import Program
from compiler.ir.types import Type, describe_axes
from msnn.exports.export import plan_exports, target_names
from msnn.exports.target import AnyPlan
from msnn.model.model import Model
from msnn.tables import count, table_text
from spec_schema.diagnostics.diagnostic import Findings, SpecError


def exports_text(model: Model) -> str:
    """A table of ports for each target of the spec, or for all if it names none.

    Raises SpecError if an entry of `export:` does not fit the model.
    """
    findings = Findings()
    plans = plan_exports(
        model, target_names((), model.spec.export, sections=model.problems), findings
    )
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    return "\n\n".join(_plan(plan) for plan in plans)


def _plan(plan: AnyPlan) -> str:
    program = plan.program
    interface = step_interface(program)
    rows = [_input(port) for port in interface.inputs]
    for output in interface.outputs:
        type = program.step[output.node].type
        range = range_text(program.expected_range(output.name))
        rows.append(("out", output.name, *_type(type), range, _predicted(program, output.name)))
    for state in interface.states:
        about = state.doc.strip().partition("\n")[0]
        shape = describe_axes(state.axes) if state.axes else ""
        unit = "" if state.unit is None else state.unit.text
        rows.append(("state", state.name, unit, shape, range_text(state.range), about))
    table = table_text(("port", "name", "unit", "shape", "range", ""), rows)
    return f"{plan.target.name}, {plan.dtype}\n{table}"


def _input(port: Port) -> Sequence[str]:
    return ("in", port.signal.name, *_type(port.type), range_text(port.signal.range), _when(port))


def _type(type: Type) -> tuple[str, str]:
    shape = describe_axes(type.axes) if type.axes else ""
    return "" if type.unit is None else type.unit.text, shape


def range_text(bounds: tuple[float, float] | None) -> str:
    """`low … high`; empty without a range."""
    return "" if bounds is None else f"{bounds[0]:g} … {bounds[1]:g}"


def _when(port: Port) -> str:
    if port.lag:
        return f"the sample of {count(port.lag, 'step')} ago"
    return f"this sample and the next {port.last}" if port.last > 0 else "this sample"


def _predicted(program: Program, name: str) -> str:
    prediction = program.output(name).predicts
    facts = [f"{count(program.late, 'step')} late"] if program.late else []
    if prediction is not None:
        # a step that is late answers for an earlier sample (decision 0209)
        ahead = prediction.ahead - program.late
        facts.append(f"predicts {prediction.signal}[t{f'{ahead:+d}' if ahead else ''}]")
    return ", ".join(facts)


def left_out(plan: AnyPlan) -> str:
    """A line about slices of arrays that the export omits because they are 0; empty if there are
    none.
    """
    if not plan.cuts:
        return ""
    kept = ", ".join(f"{len(cut.kept)} of {cut.size} in {cut.parameter}" for cut in plan.cuts)
    return f"without slices that are 0: kept are {kept}"
