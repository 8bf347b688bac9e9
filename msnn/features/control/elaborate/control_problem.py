"""Makes the optimal control problem of a spec that has an `mpc` section."""

from __future__ import annotations

from collections.abc import Container, Iterable

from compiler.ir.nodes import extents
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Program
from compiler.ir.types import describe_axes
from compiler.jacobian.matrices import Vector, vector_of
from compiler.linking.link import Linked
from compiler.lowering.context import LoweringFailed, Sampling
from msnn.features.control.elaborate.bounds import control_limits, path_limits, scales_of
from msnn.features.control.elaborate.control_program import (
    STAGE,
    TERMINAL,
    ControlSpec,
    control_program,
    control_spec,
    signals_in_step,
)
from msnn.features.control.errors import control as errors
from msnn.features.control.keys import InteriorPoint, OptimalControl
from msnn.features.control.problem.optimal_control import ControlProblem
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.errors import shapes, units
from spec_schema.units.unit import ONE

ITERATIONS = {"converged": 50, "fixed": 5}
"""Default number of iterations: the maximum for `converged`, the exact number for `fixed`."""
TOLERANCE = 1e-6
"""Default tolerance of the residual of the optimality conditions."""
_UNUSED = "W0301"
_COSTS = {STAGE: "cost.stage", TERMINAL: "cost.terminal"}
"""The keys of the outputs that are costs."""


def asked_control(linked: Linked, section: OptimalControl) -> ControlSpec:
    """The linked spec of a model extended by all formulas of its `mpc` section, to be compiled.

    Raises SpecError if the section does not fit the declarations of the spec.
    """
    findings = Findings()
    asked = control_spec(linked, section, findings)
    findings.raise_errors()
    return asked


def control_problem(
    asked: ControlSpec, program: Program, said: Iterable[Diagnostic]
) -> tuple[ControlProblem, tuple[Diagnostic, ...]]:
    """The optimal control problem, from the compiled `program` of `asked_control`, and its
    warnings.

    `said` are the warnings of that compilation that the model alone does not cause. Parameters are
    those of the program; `trained` replaces them by weights. Raises SpecError with every mistake.
    """
    findings = Findings()
    # what the asked model alone leaves unused is a reference, which `_report_unused` tells in words
    # of its own
    findings.report(*(found for found in said if found.code != _UNUSED))
    problem = _problem(asked, program, findings)
    findings.raise_errors()
    assert problem is not None
    return problem, findings.in_order


def _problem(asked: ControlSpec, program: Program, findings: Findings) -> ControlProblem | None:
    section = asked.section
    _check_costs(asked, program, findings)
    # u[t−1] is a state only where a rate or a held block asks for it: each one costs every solve
    held = any(block.value > 1 for block in section.blocks)
    followed = [
        name
        for name in asked.controls
        if held or (name in section.bounds and section.bounds[name].rate is not None)
    ]
    step = control_program(asked, program, followed, findings)
    if step is None:
        return None
    scales = scales_of(section, step)
    # each of these adds outputs for its limits, so the program is handed from one to the next
    step, controls = control_limits(asked, step, scales, findings)
    step, paths = path_limits(asked, step, scales, findings)
    _check_terminal(asked, step, findings)
    horizon = _horizon(section, step, findings)
    if horizon is None or findings.failed:
        return None
    # of the step with the limits in it: a reference may be read by a limit alone
    read = extents(step.step, log=False)
    _report_unused(section, read, findings)
    others = [name for name in read if name not in (*asked.controls, *section.references)]
    previewed = {name for name, entry in section.references.items() if entry.preview}
    previewed |= {entry.value for entry in section.preview}
    # the entry as it is without keys: its defaults stand in one place, the schema
    solver = section.interior_point or InteriorPoint.model_construct(place=section.place)
    problem = ControlProblem(
        program=step,
        states=vector_of("x", [(state.name, state.axes, state.unit) for state in step.states]),
        controls=_ports("u", step, asked.controls),
        disturbances=_ports("d", step, others),
        references=_ports("r", step, [name for name in section.references if name in read]),
        previewed=frozenset(previewed & read.keys()),
        stage=STAGE,
        terminal=TERMINAL if section.cost.terminal is not None else None,
        control_limits=controls,
        path_limits=paths,
        horizon=horizon,
        blocks=tuple(block.value for block in section.blocks) or (1,) * horizon,
        state_scales={state.name: scales.get(state.name, 1.0) for state in step.states},
        hessian=section.hessian,
        structure=solver.structure,
        mode=solver.mode,
        iterations=solver.iterations or ITERATIONS[solver.mode],
        tolerance=solver.tolerance or TOLERANCE,
    )
    # a spec without a controller is checked without what judges one
    from msnn.features.control.elaborate.plausible import check_plausible

    check_plausible(problem, section, findings)
    return problem


def _check_costs(asked: ControlSpec, program: Program, findings: Findings) -> None:
    """Reports a cost that is not a scalar without unit."""
    for output in program.outputs:
        key = _COSTS.get(output.name)
        if key is None:
            continue
        assert output.span is not None
        type = program.step[output.node].type
        if type.axes:
            wanted, found = "one number", describe_axes(type.axes)
            repair = "sum it over its axes: `sum(e**2)`"
            findings.report(shapes.wrong_axes(f"`{key}`", wanted, found, output.span, repair))
        if type.unit is not None and not type.unit.same_as(ONE):
            unit, place = type.unit.text, output.span
            findings.report(units.units_differ(key, unit, "1", place, (), bare=None, factor=None))


def _check_terminal(asked: ControlSpec, program: Program, findings: Findings) -> None:
    if asked.section.cost.terminal is None:
        return
    node = program.output(TERMINAL).node
    # after the last sample of the horizon no control is left to choose
    for name in sorted(signals_in_step(program, node) & {*asked.controls}):
        place = asked.section.cost.terminal.span
        findings.report(errors.terminal_reads_control(name, place))


def _horizon(section: OptimalControl, program: Program, findings: Findings) -> int | None:
    try:
        horizon = Sampling(program.sample_time, findings).samples(section.horizon)
    except LoweringFailed:
        return None
    # blocks that end before or after the horizon would leave controls undecided, or decide too many
    total = sum(block.value for block in section.blocks)
    if section.blocks and total != horizon:
        place = section.blocks[-1].span
        findings.report(errors.blocks_of_other_length(total, horizon, place))
    return horizon


def _report_unused(section: OptimalControl, read: Container[str], findings: Findings) -> None:
    for name, entry in section.references.items():
        if name not in read:
            findings.report(errors.unused_reference(name, entry.place.key))


def _ports(letter: str, program: Program, names: Iterable[str]) -> Vector:
    # of the reads in step form: their window axis says how many samples ahead a port has
    types = {
        node.op.signal: node.type for _, node in program.step if isinstance(node.op, ReadSignal)
    }
    return vector_of(letter, [(name, types[name].axes, types[name].unit) for name in names])
