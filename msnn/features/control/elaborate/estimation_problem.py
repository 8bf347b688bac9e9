"""Makes the problem of an estimator of a spec that has an `estimator` section."""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import extents, parameters_read
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Output, Program, Tape
from compiler.ir.types import WINDOW, Type
from compiler.jacobian.matrices import Vector, vector_of
from compiler.passes.close_loop import LoopError, close_loop
from compiler.passes.simplify import drop_unused
from compiler.passes.to_step_form import to_step_form
from msnn.features.control.errors import estimation as errors
from msnn.features.control.errors.control import reversed_bound
from msnn.features.control.keys import Estimator, KalmanFilter, MovingHorizon
from msnn.features.control.problem.state_estimation import (
    EstimatedNumbers,
    EstimationProblem,
    Measurement,
)
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import time as times
from spec_schema.errors import units
from spec_schema.errors.states import not_closable
from spec_schema.sections.spec import Spec
from spec_schema.units.quantity import Quantity, converted
from spec_schema.units.unit import Unit

_KEPT = "estimator: "
"""Prefix of outputs that only keep states from being pruned; no name of a spec has a blank."""


def estimation_problem(spec: Spec, section: Estimator, program: Program) -> EstimationProblem:
    """The estimation problem of a spec's `section`; `program` is that of the spec, in window form.

    Raises SpecError with every mistake of the section.
    """
    findings = Findings()
    problem = _problem(spec, section.choice, section.place.key, program, findings)
    findings.raise_errors()
    assert problem is not None
    if section.mhe is not None:
        from msnn.features.control.elaborate.moving_window import check_size

        check_size(problem, section.mhe, findings)
        findings.raise_errors()
    return problem


def _problem(
    spec: Spec, section: KalmanFilter, place: Span, program: Program, findings: Findings
) -> EstimationProblem | None:
    if program.sample_time is None:
        findings.report(times.needs_sample_time("`estimator`", place))
        return None
    predicted = {
        output.predicts.signal: output for output in program.outputs if output.predicts is not None
    }
    # a filter runs the model freely: what the model itself predicts is not read from a log
    fed = [name for name in predicted if name in spec.inputs]
    try:
        closed = close_loop(program, fed)
    except LoopError as error:
        findings.report(not_closable(error.signal, error.span or place, error.reason))
        return None
    step = _with_measurements(spec, section, program, closed, findings)
    if step is None:
        return None
    deviations = _deviations(spec, section, step, findings)
    parameters = _parameters(section, step, findings)
    measured = [
        Measurement(
            name=name,
            signal=_signal(program, name),
            value=f"{_KEPT}{name}",
            std=_in_unit(name, std, _unit(program, step, name), findings),
        )
        for name, std in section.measured.items()
    ]
    window = None
    if isinstance(section, MovingHorizon):
        # a filter is read without the rooms of controllers
        from msnn.features.control.elaborate.moving_window import moving_window

        window = moving_window(section, step, findings)
    # outputs that only kept states and samples have done so
    kept = {measurement.value for measurement in measured}
    step = replace(step, outputs=tuple(o for o in step.outputs if o.name in kept))
    return EstimationProblem(
        program=step,
        states=vector_of("x", [(s.name, s.axes, s.unit) for s in step.states]),
        inputs=_inputs(step),
        measured=tuple(measured),
        deviations=deviations,
        parameters=parameters,
        window=window,
    )


def _signal(program: Program, output: str) -> str:
    predicts = program.output(output).predicts
    assert predicts is not None
    return predicts.signal


def _unit(program: Program, step: Program, output: str) -> Unit | None:
    """The unit of a measured output, else that of the signal that it predicts; None
    without either.
    """
    unit = step.step[step.output(f"{_KEPT}{output}").node].type.unit
    return unit or program.signal(_signal(program, output)).unit


def _with_measurements(
    spec: Spec, section: KalmanFilter, program: Program, closed: Program, findings: Findings
) -> Program | None:
    """The step form of the closed program, with an output for each measurement, and with all its
    states. `program` is the model before its loops were closed. None after reporting mistakes.
    """
    builder = GraphBuilder(closed.step)
    known = {output.name: output for output in closed.outputs}
    before = {output.name: output for output in program.outputs}
    predicting = [output.name for output in program.outputs if output.predicts is not None]
    tapes = {s.origin.signal: s for s in closed.states if isinstance(s.origin, Tape)}
    outputs: list[Output] = []
    for name, std in section.measured.items():
        if name not in before or before[name].predicts is None:
            findings.report(errors.not_measured(name, std.span, predicting))
            continue
        predicts = before[name].predicts
        assert predicts is not None
        # y[t] is what the step itself computes
        if predicts.ahead == 0:
            node = known[name].node
        # x[t+1] was predicted a step ago: now it is the state
        elif predicts.ahead == 1 and predicts.signal in spec.states:
            state = closed.state(predicts.signal)
            node = builder.state(state.name, Type(state.axes, state.unit))
        # what was predicted for now stands last in the register: windows end with the newest (R1)
        elif predicts.ahead == 1 and predicts.signal in tapes:
            tape = tapes[predicts.signal]
            size = tape.axes[-1].size
            whole = builder.state(tape.name, Type(tape.axes, tape.unit))
            node = builder.element(whole, WINDOW, size - 1)
        else:
            written = spec.outputs[name].predicts
            assert written is not None
            fault = errors.measured_too_late(name, predicts.signal, std.span, written.span)
            findings.report(fault)
            continue
        outputs.append(Output(f"{_KEPT}{name}", node))
    # an output of each state, lest `drop_unused` takes one that no measurement depends on
    for state in closed.states:
        node = builder.state(state.name, Type(state.axes, state.unit))
        outputs.append(Output(f"{_KEPT}{state.name} stays", node))
    if findings.failed:
        return None
    whole = replace(closed, step=builder.graph(), outputs=tuple(outputs), losses=(), expected=())
    whole = drop_unused(whole)
    # an output of each sample at t, so that no port of the step form has a lag (R13)
    builder = GraphBuilder(whole.step)
    samples = [
        Output(f"{_KEPT}{name} now", builder.signal(name, 0, 0, _sample(whole, name)))
        for name in extents(whole.step, log=False)
    ]
    return to_step_form(replace(whole, step=builder.graph(), outputs=(*whole.outputs, *samples)))


def _sample(program: Program, name: str) -> Type:
    signal = program.signal(name)
    return Type(signal.axes, signal.unit)


def _inputs(program: Program) -> Vector:
    types = {
        node.op.signal: node.type for _, node in program.step if isinstance(node.op, ReadSignal)
    }
    listed = [signal.name for signal in program.signals if signal.name in types]
    return vector_of("u", [(name, types[name].axes, types[name].unit) for name in listed])


def _deviations(
    spec: Spec, section: KalmanFilter, program: Program, findings: Findings
) -> dict[str, EstimatedNumbers]:
    """The standard deviations of the section by state; the name of a fed-back signal means its
    shift register. Unknown names are reported.
    """
    named = {state.name: state for state in program.states}
    named |= {s.origin.signal: s for s in program.states if isinstance(s.origin, Tape)}
    found: dict[str, EstimatedNumbers] = {}
    tables = (("initial", section.initial), ("process", section.process))
    for key, table in tables:
        for name, std in table.items():
            if name not in named:
                is_unread = name in spec.states
                findings.report(
                    errors.not_estimated(key, name, std.span, named, is_unread=is_unread)
                )
                continue
            state = named[name]
            number = _in_unit(name, std, state.unit, findings)
            # two tables of the spec name the same states: each gives its part of one record
            before = found.get(state.name, EstimatedNumbers(initial=0.0, drift=0.0))
            found[state.name] = (
                replace(before, initial=number)
                if key == "initial"
                else replace(before, drift=number)
            )
    return found


def _parameters(
    section: KalmanFilter, program: Program, findings: Findings
) -> dict[str, EstimatedNumbers]:
    read = parameters_read(program.step)
    found: dict[str, EstimatedNumbers] = {}
    for name, entry in section.parameters.items():
        if name not in read:
            findings.report(errors.not_a_read_parameter(name, entry.place.key, read))
            continue
        unit = program.parameter(name).unit
        low, high = (_limit(name, end, unit, findings) for end in (entry.min, entry.max))
        # equal ends are legal: the parameter is known then, and keeps to them
        if low is not None and high is not None and low > high:
            suffix = "" if unit is None else f" {unit.text}"
            ends = f"{low:g}{suffix}", f"{high:g}{suffix}"
            findings.report(reversed_bound(name, *ends, entry.place.key))
        found[name] = EstimatedNumbers(
            initial=_in_unit(name, entry.std, unit, findings),
            drift=0.0 if entry.walk is None else _in_unit(name, entry.walk, unit, findings),
            minimum=low,
            maximum=high,
        )
    return found


def _in_unit(name: str, std: Quantity, unit: Unit | None, findings: Findings) -> float:
    """A standard deviation in the unit of its state or signal; a number without unit is in that
    unit. Units that do not fit are reported.
    """
    # a deviation of 1 °C is one of 1 K: the factor counts, not the offset as it does in `_limit`
    number = _converted(name, std, unit, findings, is_distance=True)
    # any number after a report, which ends the compilation
    return std.value if number is None else number


def _limit(
    name: str, limit: Quantity | None, unit: Unit | None, findings: Findings
) -> float | None:
    return None if limit is None else _converted(name, limit, unit, findings)


def _converted(
    name: str,
    written: Quantity,
    unit: Unit | None,
    findings: Findings,
    *,
    is_distance: bool = False,
) -> float | None:
    if unit is None and written.unit is not None:
        findings.report(units.unit_of_none(name, written.text, written.span))
        return written.value
    return converted(written, unit, findings, is_distance=is_distance)
