"""Describes a program for users: interface, states, parameters, and the samples it reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from backends.ports.step_interface import Port, port_names, step_interface
from compiler.ir.nodes import Extent, extents
from compiler.ir.ops import ReadSamples
from compiler.ir.program import (
    Declared,
    History,
    LayerMemory,
    Output,
    Parameter,
    Program,
    Role,
    State,
    Tape,
)
from compiler.ir.types import Axis, describe_axes
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.data.rollout_rows import reach
from msnn.exports.describe import range_text
from msnn.reports.summary import summary_line
from msnn.tables import count, table_text
from spec_schema.units.unit import Unit


def interface_text(program: Program, others: Iterable[Program] = ()) -> str:
    """Tables of the ports, states and parameters of a program in window form.

    `others` are programs of a controller and an estimator, whose costs may use further states.
    """
    step = _step_form(program)
    sections = [
        summary_line(program),
        _dimensions(program),
        _inputs(program, step),
        _outputs(program),
        _states(step, others),
        _expected(program),
        _parameters(program),
        _losses(program),
    ]
    return "\n\n".join(section for section in sections if section)


def interface_record(program: Program) -> dict[str, Any]:
    """The interface of the step form as JSON values, in the format of exports."""
    # brings the interpreter with it, which tables do not need
    from backends.ports.metadata import interface_metadata

    step = _step_form(program)
    interface = step_interface(step)
    return interface_metadata(step, interface, port_names(interface))


def windows_text(program: Program) -> str:
    """The samples that the step, the losses and the start read of every signal, with spec lines."""
    step, log = extents(program.step, log=False), extents(program.step, log=True)
    start = extents(program.start, log=True)
    rows = [
        (
            signal.name,
            signal.role.value,
            _samples(step.get(signal.name)),
            _samples(log.get(signal.name)),
            _samples(start.get(signal.name), "t0"),
            _duration(program, step.get(signal.name)),
            _lines_that_read(program, signal.name),
        )
        for signal in program.signals
    ]
    far = reach(program)
    table = table_text(_WINDOW_HEADER, rows)
    return (
        f"{table}\n\nA rollout of N steps from row t0 needs the rows "
        f"{_time('t0', -far.back)} … {_time('t0+N', far.ahead - 1)}."
    )


_WINDOW_HEADER = (
    "signal",
    "role",
    "step reads",
    "losses read",
    "start reads",
    "duration",
    "in lines",
)


def _duration(program: Program, extent: Extent | None) -> str:
    """The duration of the step's window: samples times sample time."""
    if extent is None or program.sample_time is None:
        return ""
    return f"{(extent.last - extent.first + 1) * program.sample_time:g} s"


def _lines_that_read(program: Program, name: str) -> str:
    """A text with the lines of the spec whose formulas read the signal."""
    lines = {
        node.span.line
        for graph in (program.step, program.start)
        for _, node in graph
        if isinstance(node.op, ReadSamples) and node.op.signal == name and node.span
    }
    return ", ".join(map(str, sorted(lines)))


def _step_form(program: Program) -> Program:
    return to_step_form(prune_outputs(program, [output.name for output in program.outputs]))


def _dimensions(program: Program) -> str:
    rows = [(d.name, str(d.size), ", ".join(d.labels)) for d in program.dimensions]
    return table_text(("dimension", "size", "labels"), rows, numbers=[1]) if rows else ""


def _inputs(program: Program, step: Program) -> str:
    read = extents(program.step, log=False)
    ports = {port.signal.name: port for port in step_interface(step).inputs}
    rows = [
        (
            signal.name,
            _unit(signal.unit),
            _shape(signal.axes),
            _samples(read.get(signal.name)),
            _port(ports.get(signal.name)),
            range_text(signal.range),
            _line(signal.doc),
        )
        for signal in program.signals
        if signal.role is Role.INPUT
    ]
    header = ("input", "unit", "shape", "reads", "port takes", "range", "doc")
    return table_text(header, rows) if rows else ""


def _outputs(program: Program) -> str:
    rows = [
        (
            output.name,
            _unit(program.step[output.node].type.unit),
            _shape(program.step[output.node].type.axes),
            _predicted(output),
            _line(output.doc),
        )
        for output in program.outputs
    ]
    return table_text(("output", "unit", "shape", "predicts", "doc"), rows)


def _predicted(output: Output) -> str:
    if output.predicts is None:
        return ""
    return f"{output.predicts.signal}[{_time('t', output.predicts.ahead)}]"


def _states(step: Program, others: Iterable[Program]) -> str:
    states = {state.name: state for state in step.states}
    for other in others:
        declared = (state for state in other.states if isinstance(state.origin, Declared))
        states = {**{state.name: state for state in declared}, **states}
    # those of outputs first, as exports have them
    order = sorted(states.values(), key=lambda state: state not in step.states)
    rows = [
        (state.name, _unit(state.unit), _shape(state.axes), _origin(state), _line(state.doc))
        for state in order
    ]
    return table_text(("state", "unit", "shape", "holds", "doc"), rows) if rows else ""


def _expected(program: Program) -> str:
    ranges = {
        entry.name: (_unit(program.step[entry.node].type.unit), range_text(entry.range))
        for entry in program.expected
    }
    rows = [(name, *about) for name, about in ranges.items()]
    return table_text(("equation", "unit", "range"), rows) if rows else ""


def _origin(state: State) -> str:
    match state.origin:
        case Declared() if state.fit_over is not None:
            over = state.fit_over or "each whole run"
            return f"declared in the spec, its start fitted over {over}"
        case Declared():
            return "declared in the spec"
        case LayerMemory():
            return "the memory of a layer or call"
        case History(source):
            return f"the past of {source}"
        case Tape(signal, _):
            return f"the past of {signal}, fed back"


def _parameters(program: Program) -> str:
    rows = [
        (
            parameter.name,
            _unit(parameter.unit),
            _shape(parameter.axes),
            _values(parameter),
            _parameter_bounds(parameter),
            "" if parameter.learn else "fixed",
            _line(parameter.doc),
        )
        for parameter in program.parameters
    ]
    header = ("parameter", "unit", "shape", "initial", "bounds", "learned", "doc")
    return table_text(header, rows) if rows else ""


def _losses(program: Program) -> str:
    rows = [(loss.name, loss.measured, f"{loss.weight * loss.share:g}") for loss in program.losses]
    return table_text(("loss", "measure", "weight"), rows, numbers=[2]) if rows else ""


def _line(doc: str) -> str:
    """The first line of a text."""
    return doc.strip().partition("\n")[0]


def _unit(unit: Unit | None) -> str:
    return "" if unit is None else unit.text


def _shape(axes: tuple[Axis, ...]) -> str:
    return describe_axes(axes) if axes else ""


def _samples(extent: Extent | None, now: str = "t") -> str:
    return "" if extent is None else extent.text(now)


def _time(now: str, offset: int) -> str:
    return f"{now}{offset:+d}" if offset else now


def _port(port: Port | None) -> str:
    if port is None:
        return ""
    if port.lag:
        return f"the sample of {count(port.lag, 'step')} ago"
    if port.last > 0:
        return f"this sample and the next {port.last}"
    return "this sample"


def _parameter_bounds(parameter: Parameter) -> str:
    match parameter.minimum, parameter.maximum:
        case None, None:
            return ""
        case None, float(high):
            return f"below {high:g}"
        case float(low), None:
            return f"above {low:g}"
        case low, high:
            return f"{low:g} … {high:g}"


_MOST_SHOWN = 5


def _values(parameter: Parameter) -> str:
    shown = [f"{value:.4g}" for value in parameter.initial]
    return ", ".join(_shortened(shown))


def _shortened(shown: list[str]) -> Iterator[str]:
    yield from shown[:_MOST_SHOWN]
    if len(shown) > _MOST_SHOWN:
        yield f"… {len(shown)} in all"
