"""Checks that a Program is legal: an executable specification of the IR.

It runs before and after each pass and when a program file is read. Later code may therefore rely on
a legal program.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from compiler.ir.nodes import needed, needed_over_time
from compiler.ir.ops import ReadLog, ReadSignal, ReadState, Window
from compiler.ir.program import (
    Declared,
    Expected,
    Fit,
    Graph,
    History,
    LayerMemory,
    Loss,
    Node,
    NodeId,
    Parameter,
    Program,
    Signal,
    State,
    Tape,
)
from compiler.ir.rules import LONGEST_NAME, AxesOfSources, broken_axes, broken_rule
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type

MOST_NODES = 1_000_000
MOST_SECTIONS = 64
"""Maximum order of a fitted filter: the size of its equations is quadratic in the order."""
LARGEST_TOTAL = 1 << 27
"""Maximum number of elements of all values of a graph together: 1 GiB in float64."""


class InvalidProgram(AssertionError):  # noqa: N818  (a fact about a program, as in the IR's papers)
    """A program breaks the rule of the IR that `reason` states. `node` is the illegal node, None if
    no single node is at fault.
    """

    def __init__(self, reason: str, node: Node | None = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.node = node


def verify(program: Program) -> None:
    """Raises InvalidProgram unless all rules hold, among them:

    - names are unique within signals, parameters, states, outputs, losses and dimensions, and every
      reference names an existing one;
    - operands come before their users; each node obeys the rule of its operation (`rules.py`);
    - `start` reads parameters and the log only;
    - outputs and the states that they need do not read the log; targets of losses read nothing
      else;
    - `next` and `start` of a state have the axes of the state; outputs and losses are real-valued;
    - ranges, bounds, numbers and sizes are within their limits.
    """
    _unique("program", (program.name,))
    if program.sample_time is not None:
        valid = math.isfinite(program.sample_time) and program.sample_time > 0
        _require(valid, "the sample time is not a positive number")
    _unique("dimension", (dimension.name for dimension in program.dimensions))
    _unique("signal", (signal.name for signal in program.signals))
    _unique("parameter", (parameter.name for parameter in program.parameters))
    _unique("state", (state.name for state in program.states))
    _unique("output", (output.name for output in program.outputs))
    _unique("loss", (loss.name for loss in program.losses))
    for signal in program.signals:
        _check_signal(signal)
    for parameter in program.parameters:
        _check_parameter(parameter)
    signals = {signal.name: signal.axes for signal in program.signals}
    for parameter in program.parameters if program.losses else ():
        statistic = parameter.statistic
        # statistics are taken over training rows; exports have no losses and may lack the signal
        known = statistic is None or signals.get(statistic.signal) == parameter.axes
        _require(known, f"parameter `{parameter.name}` is a statistic of no such signal")
    sources = AxesOfSources(
        signals,
        {parameter.name: parameter.axes for parameter in program.parameters},
        {state.name: state.axes for state in program.states},
    )
    _check_graph(program.step, sources)
    _check_graph(program.start, sources)
    # R7: `init` never reads the simulation
    for _, node in program.start:
        if isinstance(node.op, ReadSignal | ReadState | Window):
            raise InvalidProgram("the start reads the simulation", node)
    for state in program.states:
        _check_state(program, state)
    for output in program.outputs:
        _require(_real(program.step, output.node), f"output `{output.name}` is no number")
        predicts = output.predicts
        if predicts is not None:
            known = predicts.signal in sources.signals and predicts.ahead >= 0
            _require(known, f"output `{output.name}` predicts no signal")
    arrays = {parameter.name for parameter in program.parameters}
    for loss in program.losses:
        named = loss.penalty is None or loss.penalty.parameter in arrays
        _require(named, f"loss `{loss.name}` is a penalty of no parameter")
        _check_loss(program.step, loss)
    for entry in program.expected:
        _check_expected(program.step, entry)
    _unique("fit", (fit.layer for fit in program.fits))
    for fit in program.fits:
        _check_fit(fit, sources)
    _check_log_reads(program)


def _require(holds: bool, reason: str) -> None:
    if not holds:
        raise InvalidProgram(reason)


def _unique(what: str, names: Iterable[str]) -> None:
    seen = set[str]()
    for name in names:
        legal = bool(name) and len(name) <= LONGEST_NAME and name.isprintable()
        _require(legal, f"a {what} has no proper name")
        _require(name not in seen, f"{what} `{name}` is there twice")
        seen.add(name)


def _check_axes(what: str, axes: tuple[Axis, ...]) -> None:
    reason = broken_axes(axes)
    _require(reason is None, f"{what}: {reason}")


def _check_signal(signal: Signal) -> None:
    what = f"signal `{signal.name}`"
    _check_axes(what, signal.axes)
    names = {axis.name for axis in signal.axes}
    _require(not names & {WINDOW, UNNAMED}, f"{what} has an axis that is no dimension")
    _check_range(what, signal.range)


def _check_range(what: str, bounds: tuple[float, float] | None) -> None:
    if bounds is not None:
        # a bound that is NaN fails as well
        _require(bounds[0] < bounds[1], f"{what} has an empty range")


def _check_parameter(parameter: Parameter) -> None:
    what = f"parameter `{parameter.name}`"
    _check_axes(what, parameter.axes)
    size = math.prod(axis.size for axis in parameter.axes)
    numbers = (*parameter.initial, parameter.scale)
    finite = len(parameter.initial) == size and all(math.isfinite(value) for value in numbers)
    _require(finite, f"{what} has not one finite number an element")
    _require(parameter.scale > 0, f"{what} has no positive scale")
    low = -math.inf if parameter.minimum is None else parameter.minimum
    high = math.inf if parameter.maximum is None else parameter.maximum
    inside = low < high and all(low <= value <= high for value in parameter.initial)
    _require(inside, f"{what} starts outside its bounds")
    if parameter.prior is not None:
        spread = 0.0 < parameter.prior.std < math.inf and math.isfinite(parameter.prior.mean)
        _require(spread and parameter.learn, f"{what} has a prior that says nothing")


def _check_graph(graph: Graph, sources: AxesOfSources) -> None:
    _require(len(graph) <= MOST_NODES, f"a graph has more than {MOST_NODES} nodes")
    total = 0
    for index, node in graph:
        # ordered nodes have no cycles, and one pass in this order evaluates them
        if node.args and not 0 <= min(node.args) <= max(node.args) < index:
            raise InvalidProgram(f"node {index} uses a node that does not stand before it", node)
        reason = broken_rule(node, tuple(graph[arg].type for arg in node.args), sources)
        if reason is not None:
            raise InvalidProgram(f"node {index}: {type(node.op).__name__}: {reason}", node)
        total += node.type.size
    # many values of legal size can still be too large together
    _require(total <= LARGEST_TOTAL, f"the values of a graph have {total} elements together")


def _check_state(program: Program, state: State) -> None:
    what = f"state `{state.name}`"
    _check_axes(what, state.axes)
    _check_range(what, state.range)
    _require(state.on_range == "flag" or state.range is not None, f"{what} has no range to act on")
    # buffers have the window as their last axis
    windowed = Type(state.axes).window is not None
    match state.origin:
        case Declared() | LayerMemory():
            pass
        case History():
            _require(windowed, f"{what} is a buffer without a window")
        case Tape(signal, ahead):
            known = any(s.name == signal for s in program.signals) and ahead >= 0
            _require(known, f"{what} is the tape of no signal")
            _require(windowed, f"{what} is a buffer without a window")
    for graph, node, part in (
        (program.step, state.next, "next"),
        (program.start, state.start, "start"),
    ):
        fits = _real(graph, node) and graph[node].type.axes == state.axes
        _require(fits, f"{what} has other axes than its {part} value")


def _check_loss(step: Graph, loss: Loss) -> None:
    what = f"loss `{loss.name}`"
    _require(_real(step, loss.prediction), f"{what} has no number to score")
    finite = math.isfinite(loss.weight) and math.isfinite(loss.share)
    _require(finite, f"{what} has no finite weight")
    if loss.target is not None:
        same = _real(step, loss.target)
        same = same and step[loss.target].type.axes == step[loss.prediction].type.axes
        _require(same, f"{what} compares values of different axes")
    if loss.rows is not None:
        number = _real(step, loss.rows) and not step[loss.rows].type.axes
        _require(number, f"{what} has no number for each row")


def _check_expected(step: Graph, entry: Expected) -> None:
    what = f"equation `{entry.name}`"
    legal = 0 < len(entry.name) <= LONGEST_NAME and entry.name.isprintable()
    _require(legal, "an equation has no proper name")
    _require(_real(step, entry.node), f"{what} has a range and is no number")
    _check_range(what, entry.range)


def _check_fit(fit: Fit, sources: AxesOfSources) -> None:
    what = f"the fit of `{fit.layer}`"
    _require(len(fit.argument) > 0, f"{what} has no argument")
    _check_graph(fit.argument, sources)
    for _, node in fit.argument:
        if isinstance(node.op, ReadState | ReadLog | Window):
            raise InvalidProgram(f"{what} reads more than inputs", node)
    last = len(fit.argument) - 1
    # the last node is the value of the argument
    axes = fit.argument[last].type.axes
    _require(_real(fit.argument, last) and WINDOW not in {axis.name for axis in axes}, what)
    signal = fit.target.signal
    _require(signal in sources.signals, f"{what} has no such signal: `{signal}`")
    orders = fit.target.ahead >= 0 <= fit.num <= MOST_SECTIONS and 1 <= fit.den <= MOST_SECTIONS
    _require(orders and 0 < fit.radius <= 1, f"{what} is of no stable filter")
    target = sources.signals[signal]
    alike = fit.kind == "state_space" or Type(axes).size == Type(target).size
    _require(alike, f"{what} has not one argument for each element of `{signal}`")
    for array, size in fit.sizes(target).items():
        name = f"{fit.layer}.{array}"
        known = name in sources.parameters and Type(sources.parameters[name]).size == size
        _require(known, f"{what} has no array `{array}` of {size} elements")


def _check_log_reads(program: Program) -> None:
    step = program.step
    # a deployed step has no log (R13), only losses read it
    outputs = [output.node for output in program.outputs]
    # a state that only losses depend on runs in training only and may read the log
    deployed, _ = needed_over_time(step, {s.name: s.next for s in program.states}, outputs)
    targets = [loss.target for loss in program.losses if loss.target is not None]
    factors = [loss.rows for loss in program.losses if loss.rows is not None]
    for index, node in step:
        if deployed[index] and isinstance(node.op, ReadLog):
            raise InvalidProgram(f"node {index}: an output or its state reads the log", node)
    for what, nodes in (("a target", targets), ("the factor of rows", factors)):
        for index, node in _reached(step, nodes):
            if isinstance(node.op, ReadSignal | ReadState | Window):
                raise InvalidProgram(f"node {index}: {what} reads the simulation", node)


def _reached(graph: Graph, wanted: Sequence[NodeId]) -> Iterable[tuple[NodeId, Node]]:
    """The nodes with ids in `wanted` and all nodes that they depend on, as pairs (id, node)."""
    reached = needed(graph, wanted)
    return ((index, node) for index, node in graph if reached[index])


def _real(graph: Graph, node: NodeId) -> bool:
    return 0 <= node < len(graph) and graph[node].type.kind == "real"
