"""Prints a Program as text, for readers and for golden files of tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import assert_never

from compiler.ir import ops
from compiler.ir.program import (
    Declared,
    Graph,
    History,
    LayerMemory,
    Loss,
    Node,
    Output,
    Parameter,
    Program,
    Signal,
    State,
    Tape,
)
from compiler.ir.types import Axis, Type, describe_axes
from spec_schema.units.unit import Unit

# enough for the taps of most filters; goldens with tables stay readable
MOST_NUMBERS = 12
"""Maximum number of printed elements; a longer constant shows the first ones and their count."""


def program_text(program: Program) -> str:
    """Prints the whole program, one line per declaration and per node:

        %4: [joint=6, t=5] N*m = contract(%1, %3) over t   # line 12 x_next

    Times are written as in specs: `signal x[t-4:t]`, `log x[t+1]`. The text shows the computation.
    It omits the initialisation of training (`Fit`, `Statistic`, `fit_over`), penalties, formulas
    and the later elements of long constants; `program_file` stores everything.
    """
    return "".join(f"{line}\n" for line in _lines(program))


def node_text(index: int, node: Node) -> str:
    """Prints the node with the id `index`: its type and operation, and as a comment its line in the
    spec and its label.
    """
    place = f"line {node.span.line}" if node.span else ""
    comment = " ".join(part for part in (place, node.label or "") if part)
    text = f"%{index}: {_type(node.type)} = {_operation(node)}"
    return f"{text}   # {comment}" if comment else text


def _lines(program: Program) -> Iterator[str]:
    step = "" if program.sample_time is None else f", a sample every {program.sample_time!r} s"
    yield f"program {program.name}{step}"
    for dimension in program.dimensions:
        labels = f" ({', '.join(dimension.labels)})" if dimension.labels else ""
        yield f"dimension {dimension.name}={dimension.size}{labels}"
    yield from (_signal(signal) for signal in program.signals)
    yield from (_parameter(parameter) for parameter in program.parameters)
    yield from (_state(state) for state in program.states)
    yield from _graph("start", program.start)
    yield from _graph("step", program.step)
    yield from (_output(output) for output in program.outputs)
    yield from (_loss(loss) for loss in program.losses)
    yield from (
        f"expected {entry.name} = %{entry.node} in {_bounds(*entry.range)}"
        for entry in program.expected
    )


def _graph(name: str, graph: Graph) -> Iterator[str]:
    yield f"{name}:"
    yield from (f"  {node_text(index, node)}" for index, node in graph)


def _signal(signal: Signal) -> str:
    bounds = f" in {_bounds(*signal.range)} ({signal.on_invalid})" if signal.range else ""
    return f"{signal.role.value} {signal.name}: {_typed(signal.axes, signal.unit)}{bounds}"


def _parameter(parameter: Parameter) -> str:
    bounds = ""
    if parameter.minimum is not None or parameter.maximum is not None:
        bounds = f" in {_bounds(parameter.minimum, parameter.maximum)}"
    scale = f" scale {parameter.scale!r}" if parameter.scale != 1.0 else ""
    # its own scale is 1 then, until training has seen the data
    scale = " scale of the data" if parameter.scales_by_data else scale
    fixed = "" if parameter.learn else " fixed"
    prior = ""
    if parameter.prior is not None:
        prior = f" prior {parameter.prior.mean!r} ± {parameter.prior.std!r}"
    return (
        f"parameter {parameter.name}: {_typed(parameter.axes, parameter.unit)}"
        f" = {_numbers(parameter.initial)}{bounds}{scale}{fixed}{prior}"
    )


def _state(state: State) -> str:
    match state.origin:
        case Declared():
            origin = ""
        case LayerMemory():
            origin = ", memory"
        case History(source):
            origin = f", history of {source}"
        case Tape(signal, ahead):
            origin = f", tape of {signal} up to {_moment(ahead - 1)}"
        case _:
            assert_never(state.origin)
    bounds = f" in {_bounds(*state.range)}" if state.range else ""
    bounds += f", {state.on_range} outside" if state.on_range != "flag" else ""
    links = f"next %{state.next}, start %{state.start}"
    return f"state {state.name}: {_typed(state.axes, state.unit)}{bounds}{origin}, {links}"


def _output(output: Output) -> str:
    predicts = output.predicts
    shown = f" predicts {predicts.signal}{_time(predicts.ahead)}" if predicts else ""
    return f"output {output.name} = %{output.node}{shown}"


def _loss(loss: Loss) -> str:
    target = "" if loss.target is None else f", %{loss.target}"
    rows = "" if loss.rows is None else f", rows %{loss.rows}"
    weight = "" if loss.weight == 1.0 else f", weight {loss.weight!r}"
    share = "" if loss.share == 1.0 else f", share {loss.share!r}"
    delta = "" if loss.delta == 1.0 else f", delta {loss.delta!r}"
    cost = f"{loss.measure.value}(%{loss.prediction}{target}{delta})"
    return f"loss {loss.name} = {cost}{rows}{weight}{share}"


def _operation(node: Node) -> str:
    args = [f"%{arg}" for arg in node.args]
    listed = ", ".join(args)
    match node.op:
        case ops.Constant(values, name):
            return f"constant {_numbers(values)}{f' ({name})' if name else ''}"
        case ops.ReadParameter(name):
            return f"parameter {name}"
        case ops.ReadSignal(name, first, last):
            return f"signal {name}{_times(first, last, node.type)}"
        case ops.ReadLog(name, first, last):
            return f"log {name}{_times(first, last, node.type)}"
        case ops.ReadState(name):
            return f"state {name}"
        case ops.ReadTraining(value):
            return f"training {value}"
        case ops.Add():
            return " + ".join(args)
        case ops.Subtract():
            return " - ".join(args)
        case ops.Multiply():
            return " * ".join(args)
        case ops.Divide():
            return " / ".join(args)
        case ops.Negate():
            return f"-{listed}"
        case ops.Dropout(rate, layer):
            return f"dropout({listed}, {rate!r}{f', {layer}' if layer else ''})"
        case ops.Named(name):
            return f"{listed} as {name}"
        case ops.Minimum():
            return f"min({listed})"
        case ops.Maximum():
            return f"max({listed})"
        case ops.Clamp():
            return f"clamp({listed})"
        case ops.Compare(relation):
            return f" {relation.value} ".join(args)
        case ops.Select():
            return f"select({listed})"
        case ops.Apply(function):
            return f"{function}({listed})"
        case ops.Broadcast():
            return f"broadcast({listed})"
        case ops.Reshape():
            return f"reshape({listed})"
        case ops.Slice(axis, start, stop):
            return f"{listed}[{axis or '_'} {start}:{stop}]"
        case ops.Concat(axis):
            return f"concat({listed}) along {axis or '_'}"
        case ops.Sum(axis):
            return f"sum({listed}) over {axis or '_'}"
        case ops.Contract(axis):
            return f"contract({listed}) over {axis or '_'}"
        case ops.Window(state):
            return f"window({state}, {listed})"
        case _:
            assert_never(node.op)


def _type(type: Type) -> str:
    return f"{_typed(type.axes, type.unit)}{' bool' if type.kind == 'bool' else ''}"


def _typed(axes: tuple[Axis, ...], unit: Unit | None) -> str:
    return f"{describe_axes(axes)} {'?' if unit is None else unit.text}"


def _times(first: int, last: int, type: Type) -> str:
    if type.window is None:
        return _time(first)
    return f"[{_moment(first)}:{_moment(last)}]"


def _time(offset: int) -> str:
    return f"[{_moment(offset)}]"


def _moment(offset: int) -> str:
    return f"t{offset:+d}" if offset else "t"


def _bounds(low: float | None, high: float | None) -> str:
    return f"[{'' if low is None else repr(low)}, {'' if high is None else repr(high)}]"


def _numbers(values: Iterable[float]) -> str:
    listed = [repr(value) for value in values]
    if len(listed) > MOST_NUMBERS:
        return f"({', '.join(listed[: MOST_NUMBERS // 2])}, … {len(listed)} numbers)"
    return listed[0] if len(listed) == 1 else f"({', '.join(listed)})"
