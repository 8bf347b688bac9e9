"""Small step-form programs, each for one thing that the C backend must get right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadLog, Relation
from compiler.ir.program import (
    Declared,
    InvalidPolicy,
    NodeId,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
)
from compiler.ir.types import WINDOW, Axis, Type
from compiler.passes.to_step_form import to_step_form
from spec_schema.diagnostics.source import Span

CELL = Axis("cell", 3)


def program(
    b: GraphBuilder,
    outputs: dict[str, NodeId],
    signals: Sequence[Signal] = (),
    parameters: Sequence[Parameter] = (),
    states: Sequence[State] = (),
    starts: GraphBuilder | None = None,
    name: str = "small",
) -> Program:
    """A program of these parts, brought into step form."""
    return to_step_form(
        Program(
            name,
            0.1,
            tuple(signals),
            tuple(parameters),
            tuple(states),
            b.graph(),
            (starts or GraphBuilder()).graph(),
            tuple(Output(output, node) for output, node in outputs.items()),
        )
    )


def filtered(policy: InvalidPolicy, limits: tuple[float, float] | None, cells: bool) -> Program:
    """A mean over three samples of an input with a policy, and its last sample."""
    axes = (CELL,) if cells else ()
    b = GraphBuilder()
    window = b.signal("u", -2, 0, Type((*axes, Axis(WINDOW, 3))))
    mean = b.multiply(b.sum(window, WINDOW), b.constant(1 / 3))
    now = b.signal("u", 0, 0, Type(axes))
    signal = Signal("u", Role.INPUT, axes, range=limits, on_invalid=policy)
    return program(b, {"mean": mean, "now": now}, [signal])


def remembering(policy: InvalidPolicy, limits: tuple[float, float], cells: bool) -> Program:
    """The five samples before the present one of an input with a policy."""
    axes = (CELL,) if cells else ()
    b = GraphBuilder()
    window = b.signal("u", -5, 0, Type((*axes, Axis(WINDOW, 6))))
    past = b.rename(b.slice(window, WINDOW, 0, 5), WINDOW, "sample")
    signal = Signal("u", Role.INPUT, axes, range=limits, on_invalid=policy)
    return program(b, {"past": past}, [signal])


def starting_states() -> Program:
    """A state that starts from a number, one from the present, one from the future."""
    b, starts = GraphBuilder(), GraphBuilder()
    u = b.signal("u", 0, 0, Type())
    half = b.constant(0.5)
    names = ("fixed", "measured", "encoded")
    reads = {name: b.state(name, Type()) for name in names}
    nexts = {name: b.add(b.multiply(half, reads[name]), u) for name in names}
    future = starts.sum(starts.log("u", 0, 2, Type((Axis(WINDOW, 3),))), WINDOW)
    begin = {
        "fixed": starts.constant(0.25),
        "measured": starts.emit(ReadLog("v", 0, 0), (), Type()),
        "encoded": future,
    }
    limits = {"fixed": (-1.0, 1.0)}
    states = [
        State(name, (), None, Declared(), nexts[name], begin[name], range=limits.get(name))
        for name in names
    ]
    signals = [Signal("u", Role.INPUT), Signal("v", Role.TARGET)]
    return program(b, reads, signals, states=states, starts=starts)


def swapped_states() -> Program:
    """Two arrays that change places in each step, and one that follows a window's oldest sample."""
    b, starts = GraphBuilder(), GraphBuilder()
    type = Type((CELL,))
    left, right, late = (b.state(name, type) for name in ("left", "right", "late"))
    window = b.signal("u", -3, 0, Type((CELL, Axis(WINDOW, 4))))
    oldest = b.element(window, WINDOW, 0)
    one = starts.constant((1.0, 2.0, 3.0), (CELL,))
    two = starts.constant((-1.0, -2.0, -4.0), (CELL,))
    states = [
        State("left", type.axes, None, Declared(), right, one),
        State("right", type.axes, None, Declared(), left, two),
        State("late", type.axes, None, Declared(), oldest, two),
    ]
    outputs = {"left": left, "right": right, "late": late}
    return program(b, outputs, [Signal("u", Role.INPUT, (CELL,))], states=states, starts=starts)


def conditions() -> Program:
    """Conditions on arrays that are used more than once, and constants that loops run over."""
    b = GraphBuilder()
    axes = (Axis("wide", 7),)
    u = b.signal("u", 0, 0, Type(axes))
    weights = b.constant([0.1 * k - 0.25 for k in range(7)], axes)
    above = b.compare(Relation.GREATER, u, weights)
    chosen = b.select(above, u, weights)
    other = b.select(above, b.constant(0.0), b.negate(u))
    total = b.sum(b.multiply(chosen, b.add(other, weights)), "wide")
    return program(b, {"total": total, "other": other}, [Signal("u", Role.INPUT, axes)])


def long_chain(length: int) -> Program:
    """x ← (x·a + u)·a + u … without an end to the nesting."""
    b = GraphBuilder()
    u, a = b.signal("u", 0, 0, Type()), b.parameter("a", Type())
    value = u
    for _ in range(length):
        value = b.add(b.multiply(value, a), u)
    return program(
        b, {"y": value}, [Signal("u", Role.INPUT)], [Parameter("a", initial=(0.875,))], name="chain"
    )


def nothing_to_do() -> Program:
    """No inputs, no parameters, no states: one constant output."""
    b = GraphBuilder()
    return program(b, {"y": b.constant(2.5)}, name="still")


HOSTILE = (
    '*/ #error "out" /*',
    "x\n#error new line",
    "tail \\",
    "??/\n#error trigraph",
    "a\u202eb\u2066c",
    "int",
    "NULL",
    "λ",
    "lambda",
    "%s%n",
    "",
)
"""Names and documents of somebody who wants to write into our files."""


def hostile() -> Program:
    """Every name, document, unit-less label and file name is hostile."""
    b, starts = GraphBuilder(), GraphBuilder()
    nodes: dict[str, NodeId] = {}
    signals: list[Signal] = []
    for number, name in enumerate(HOSTILE):
        span = Span(
            file=f"../{name}.yaml", line=number + 1, column=1, end_line=number + 1, end_column=2
        )
        signals.append(Signal(name, Role.INPUT, doc=name, span=span))
        with b.at(span):
            read = b.signal(name, 0, 0, Type())
            nodes[name] = b.add(b.multiply(read, b.parameter(name, Type())), b.state(name, Type()))
            b.name(nodes[name], name)
    states = [
        State(name, (), None, Declared(), nodes[name], starts.constant(0.5), doc=name)
        for name in HOSTILE
    ]
    parameters = [Parameter(name, initial=(0.5,), doc=name) for name in HOSTILE]
    made = program(b, nodes, signals, parameters, states, starts, name=HOSTILE[0])
    outputs = tuple(Output(o.name, o.node, doc=o.name) for o in made.outputs)
    return replace(made, outputs=outputs, doc=" ".join(HOSTILE), spec_hash=HOSTILE[2])
