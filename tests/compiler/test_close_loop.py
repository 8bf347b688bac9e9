"""Loops that cannot be closed (rule R4): what is wrong, where, and the values of a cycle."""

from __future__ import annotations

from dataclasses import replace

import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, NodeId, Output, Program, Role, Signal
from compiler.ir.types import Axis, Prediction, Type
from compiler.passes.close_loop import LoopError, LoopFault, close_loop
from spec_schema.diagnostics.source import Span
from tests.programs import SAMPLES

PLACE = Span(file="loop.msnn.yaml", line=7, column=3, end_line=7, end_column=20)


def _program(b: GraphBuilder, *outputs: tuple[str, NodeId, Prediction]) -> Program:
    signals = (Signal("x", Role.INPUT), Signal("y", Role.INPUT))
    listed = tuple(Output(name, node, predicts, span=PLACE) for name, node, predicts in outputs)
    return Program("loop", None, signals, (), (), b.graph(), Graph(), listed)


def test_value_that_needs_itself_in_the_same_step_lists_the_cycle() -> None:
    b = GraphBuilder()
    with b.at(PLACE):
        x = b.signal("x", 0, 0, Type())
    y = b.signal("y", 0, 0, Type())
    speed = b.negate(x)
    b.name(speed, "speed")
    force = b.apply("sin", y)
    b.name(force, "force")
    program = _program(
        b, ("force", force, Prediction("x", 0)), ("speed", speed, Prediction("y", 0))
    )
    with pytest.raises(LoopError) as raised:
        close_loop(program, ["x", "y"])
    error = raised.value
    assert error.kind is LoopFault.CYCLE
    assert error.signal in ("x", "y")
    around = (*error.cycle, *error.cycle)
    start = around.index("x")
    assert around[start : start + 4] == ("x", "speed", "y", "force")
    assert len(error.cycle) == 4


def test_one_open_signal_breaks_the_cycle() -> None:
    b = GraphBuilder()
    x, y = b.signal("x", 0, 0, Type()), b.signal("y", 0, 0, Type())
    first, second = b.negate(x), b.apply("sin", y)
    program = _program(b, ("a", second, Prediction("x", 0)), ("b", first, Prediction("y", 0)))
    assert {s.name for s in close_loop(program, ["x"]).signals if s.role is Role.INPUT} == {"y"}


def test_future_window_of_a_closed_signal() -> None:
    b = GraphBuilder()
    with b.at(PLACE):
        x = b.signal("x", 1, 1, Type())
    program = _program(b, ("next", b.negate(x), Prediction("x", 1)))
    with pytest.raises(LoopError) as raised:
        close_loop(program, ["x"])
    assert (raised.value.kind, raised.value.signal) == (LoopFault.FUTURE, "x")
    assert raised.value.span == PLACE


def test_prediction_two_ahead_gives_the_next_sample_too() -> None:
    b = GraphBuilder()
    x = b.signal("x", -1, 1, Type((Axis("t", 3),)))
    program = _program(b, ("later", b.sum(x, "t"), Prediction("x", 2)))
    closed = close_loop(program, ["x"])
    (tape,) = closed.states
    assert tape.axes == (Axis("t", 3),)
    assert closed.start[tape.start].op == replace(closed.start[tape.start].op, first=-1, last=1)


@pytest.mark.parametrize(
    ("closed", "fault"),
    [("q", LoopFault.UNKNOWN), ("y", LoopFault.UNPREDICTED), ("x", LoopFault.PREDICTED_TWICE)],
)
def test_signals_that_cannot_be_closed(closed: str, fault: LoopFault) -> None:
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    one, two = b.negate(x), b.apply("sin", x)
    program = _program(b, ("one", one, Prediction("x", 1)), ("two", two, Prediction("x", 1)))
    with pytest.raises(LoopError) as raised:
        close_loop(program, [closed])
    assert raised.value.kind is fault
    assert closed in str(raised.value)


def test_output_with_axes_that_the_signal_lacks() -> None:
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    wide = b.broadcast(x, (Axis("k", 2),))
    with pytest.raises(LoopError) as raised:
        close_loop(_program(b, ("wide", wide, Prediction("x", 1))), ["x"])
    assert raised.value.kind is LoopFault.AXES


def test_losses_read_the_log_of_a_closed_signal() -> None:
    program = SAMPLES["fir_closed_loop"]().program
    closed = close_loop(program, ["x"])
    (loss,) = closed.losses
    assert loss.target is not None
    assert closed.step[loss.target] == program.step[program.losses[0].target or 0]
