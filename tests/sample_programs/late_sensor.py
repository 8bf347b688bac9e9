"""The sample program `late_sensor`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Declared, Output, Parameter, Program, Role, Signal, State
from compiler.ir.types import Type
from tests.sample_programs.sample import (
    METRE,
    Sample,
    taps,
    wave,
)


def late_sensor() -> Sample:
    """A level filtered from a sensor that is read two and more samples late (a port with lag 2)."""
    b = GraphBuilder()
    late = b.signal("sensor", -4, -2, Type(taps(3), METRE))
    single = b.signal("pump", -1, -1, Type())
    level = b.state("level", Type((), METRE))
    mean = b.contract(b.constant((0.25, 0.25, 0.5), taps(3)), late)
    rate = b.parameter("rate", Type())
    drift = b.multiply(rate, b.subtract(mean, level))
    pumped = b.multiply(b.constant(0.02, unit=METRE), b.apply("exp", b.negate(single)))
    level_next = b.add(b.add(level, drift), pumped)
    b.name(level_next, "level")
    starts = GraphBuilder()
    start = starts.log("sensor", -2, -2, Type((), METRE))
    program = Program(
        name="late_sensor",
        sample_time=1.0,
        signals=(
            Signal("sensor", Role.INPUT, (), METRE, range=(0.0, 3.0)),
            Signal("pump", Role.INPUT, range=(-1.0, 1.0)),
        ),
        parameters=(Parameter("rate", (), None, (0.3,), minimum=0.0, maximum=1.0),),
        states=(State("level", (), METRE, Declared(), level_next, start),),
        step=b.graph(),
        start=starts.graph(),
        outputs=(Output("level_now", level),),
    )
    return Sample(
        program,
        (),
        lambda rows, seed: {
            "sensor": 1.5 + 0.5 * wave(rows, seed),
            "pump": 0.5 * wave(rows, seed + 1),
        },
    )
