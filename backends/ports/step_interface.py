"""Lists the ports of a step-form program for exports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from backends.ports.identifiers import c_identifier
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadLog, ReadParameter, ReadSignal
from compiler.ir.program import Graph, NodeId, Output, Parameter, Program, Signal, State
from compiler.ir.types import WINDOW, Axis, Type


@dataclass(frozen=True, slots=True)
class Port:
    """An input of an exported function: the samples t+first … t+last of a signal. `type` has a
    window axis unless it is a single sample.
    """

    signal: Signal
    type: Type
    first: int
    last: int

    @property
    def lag(self) -> int:
        """By how many samples the newest value of the port is older than t: d for s[t-d]; 0 for a
        newer one.
        """
        return max(-self.last, 0)


@dataclass(frozen=True, slots=True)
class StepInterface:
    """The ports of an exported program, in the order of the program: those of the step, and those
    of the start, which computes initial states.
    """

    inputs: tuple[Port, ...]
    states: tuple[State, ...]
    parameters: tuple[Parameter, ...]
    """Parameters that outputs and next states depend on."""
    outputs: tuple[Output, ...]
    step_nodes: tuple[NodeId, ...]
    """Nodes that outputs and next states depend on, without losses."""
    start_windows: tuple[Port, ...]
    """All samples around t0 that the start graph reads, one window per signal."""
    start_parameters: tuple[Parameter, ...]
    start_nodes: tuple[NodeId, ...]


@dataclass(frozen=True, slots=True)
class PortNames:
    """The names of ports in an export, by name in the spec; all are different identifiers."""

    inputs: dict[str, str]
    states: dict[str, str]
    parameters: dict[str, str]
    outputs: dict[str, str]
    next_states: dict[str, str]
    """`<state>_next`, or `<state>_next_state` if an output or another port has that name."""
    start_windows: dict[str, str]
    """`<signal>_window`."""


def step_interface(program: Program) -> StepInterface:
    """The ports of a program in step form. Raises ValueError if the program is in another form: an
    input is read more than once, or the step reads the log.
    """
    outputs = [output.node for output in program.outputs]
    step_nodes = _nodes(program.step, [*outputs, *(s.next for s in program.states)])
    start_nodes = _nodes(program.start, [state.start for state in program.states])
    return StepInterface(
        inputs=_inputs(program, step_nodes),
        states=program.states,
        parameters=_parameters(program, program.step, step_nodes),
        outputs=program.outputs,
        step_nodes=step_nodes,
        start_windows=_windows(program, start_nodes),
        start_parameters=_parameters(program, program.start, start_nodes),
        start_nodes=start_nodes,
    )


def port_names(interface: StepInterface, reserved: Iterable[str] = ()) -> PortNames:
    """Unique names for all ports, none of them in `reserved`. Inputs come first and keep their
    names if names collide.
    """
    taken = set(reserved)

    def identifiers(names: Iterable[str], suffix: str = "") -> dict[str, str]:
        return {name: c_identifier(name + suffix, taken) for name in names}

    def next_value(state: str) -> str:
        # an empty set avoids numbering: `x_next_state` is clearer than `x_next_2`
        usual = c_identifier(f"{state}.next", set())
        return c_identifier(f"{state}.next_state" if usual in taken else f"{state}.next", taken)

    # a parameter that both functions read is one port
    parameters = {p.name: p for p in (*interface.parameters, *interface.start_parameters)}
    states = [state.name for state in interface.states]
    return PortNames(
        # in this order: earlier ports keep their names; next values come last
        inputs=identifiers(port.signal.name for port in interface.inputs),
        outputs=identifiers(output.name for output in interface.outputs),
        states=identifiers(states),
        parameters=identifiers(parameters),
        next_states={state: next_value(state) for state in states},
        start_windows=identifiers(
            (port.signal.name for port in interface.start_windows), ".window"
        ),
    )


def _nodes(graph: Graph, roots: Iterable[NodeId]) -> tuple[NodeId, ...]:
    marked = needed(graph, roots)
    return tuple(index for index in range(len(graph)) if marked[index])


def _inputs(program: Program, nodes: tuple[NodeId, ...]) -> tuple[Port, ...]:
    found: dict[str, Port] = {}
    for index in nodes:
        node = program.step[index]
        match node.op:
            case ReadSignal(name, first, last):
                if name in found:
                    message = f"input `{name}` is read more than once: the program has no step form"
                    raise ValueError(message)
                found[name] = Port(program.signal(name), node.type, first, last)
            case ReadLog(name):
                message = f"an output or a next state reads the record of `{name}`"
                raise ValueError(message)
            case _:
                pass
    return tuple(found[signal.name] for signal in program.signals if signal.name in found)


def _windows(program: Program, nodes: tuple[NodeId, ...]) -> tuple[Port, ...]:
    extents: dict[str, tuple[int, int]] = {}
    for index in nodes:
        match program.start[index].op:
            case ReadLog(name, first, last) | ReadSignal(name, first, last):
                # one window holds all that is read of a signal: `reset` takes each sample once
                before = extents.get(name, (first, last))
                extents[name] = (min(first, before[0]), max(last, before[1]))
            case _:
                pass
    ports: list[Port] = []
    for signal in program.signals:
        if signal.name in extents:
            first, last = extents[signal.name]
            axes = (*signal.axes, Axis(WINDOW, last - first + 1))
            ports.append(Port(signal, Type(axes, signal.unit), first, last))
    return tuple(ports)


def _parameters(program: Program, graph: Graph, nodes: tuple[NodeId, ...]) -> tuple[Parameter, ...]:
    ops = [graph[index].op for index in nodes]
    names = {op.name for op in ops if isinstance(op, ReadParameter)}
    return tuple(parameter for parameter in program.parameters if parameter.name in names)
