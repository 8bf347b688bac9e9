"""The sample program `fir_closed_loop`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Loss, Measure, Output, Parameter, Program, Role, Signal
from compiler.ir.types import Prediction, Type
from tests.sample_programs.sample import (
    METRE,
    NEWTON,
    Sample,
    taps,
    wave,
)


def fir_closed_loop() -> Sample:
    """x_next = h · x[t-4:t] + g · F[t:t], predicts x[t+1]: the mass-spring-damper's FIR variant."""
    b = GraphBuilder()
    gain = METRE / NEWTON
    window = b.signal("x", -4, 0, Type(taps(5), METRE))
    force = b.signal("F", 0, 0, Type(taps(1), NEWTON))
    past = b.contract(b.parameter("h.weight", Type(taps(5))), window)
    push = b.contract(b.parameter("g.weight", Type(taps(1), gain)), force)
    x_next = b.add(past, push)
    b.name(x_next, "x_next")
    target = b.log("x", 1, 1, Type((), METRE))
    program = Program(
        name="fir_closed_loop",
        sample_time=0.2,
        signals=(
            Signal("x", Role.INPUT, (), METRE, range=(-5.0, 5.0), doc="Position"),
            Signal("F", Role.INPUT, (), NEWTON, range=(-10.0, 10.0), doc="Force"),
        ),
        parameters=(
            Parameter("h.weight", taps(5), None, (0.031, -0.22, 0.17, -0.41, 1.13)),
            Parameter("g.weight", taps(1), gain, (0.087,)),
        ),
        states=(),
        step=b.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("x_next", x_next, Prediction("x", 1)),),
        losses=(Loss("x_next", Measure.MSE, x_next, target),),
    )
    return Sample(
        program,
        ("x",),
        lambda rows, seed: {
            "x": wave(rows, seed),
            "F": wave(rows, seed + 1),
        },
    )
