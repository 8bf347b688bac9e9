"""The sample program `spring_damper_rk4`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import (
    Declared,
    Loss,
    Measure,
    NodeId,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
)
from compiler.ir.types import Type
from spec_schema.units.parser import parse_unit
from tests.sample_programs.sample import (
    METRE,
    NEWTON,
    SECOND,
    SPEED,
    Sample,
    wave,
)


def spring_damper_rk4() -> Sample:
    """m·a = F − c·v − k·x as continuous states x, v, one Runge-Kutta step of order 4 a sample."""
    b = GraphBuilder()
    dt = b.constant(0.05, unit=SECOND)
    half_dt = b.constant(0.025, unit=SECOND)
    per_speed = NEWTON / SPEED
    per_metre = NEWTON / METRE
    mass_unit = parse_unit("kg")
    mass = b.parameter("mass", Type((), mass_unit))
    damping = b.parameter("damping", Type((), per_speed))
    stiffness = b.parameter("stiffness", Type((), per_metre))
    force = b.signal("F", 0, 0, Type((), NEWTON))
    x, v = b.state("x", Type((), METRE)), b.state("v", Type((), SPEED))

    def slope(position: NodeId, speed: NodeId) -> tuple[NodeId, NodeId]:
        resisting = b.add(b.multiply(damping, speed), b.multiply(stiffness, position))
        return speed, b.divide(b.subtract(force, resisting), mass)

    def moved(by: NodeId, slopes: tuple[NodeId, NodeId]) -> tuple[NodeId, NodeId]:
        return b.add(x, b.multiply(by, slopes[0])), b.add(v, b.multiply(by, slopes[1]))

    first = slope(x, v)
    second = slope(*moved(half_dt, first))
    third = slope(*moved(half_dt, second))
    fourth = slope(*moved(dt, third))
    sixth, two = b.constant(0.05 / 6, unit=SECOND), b.constant(2.0)
    inner = [b.multiply(two, b.add(second[i], third[i])) for i in (0, 1)]
    total = (
        b.add(b.add(first[0], inner[0]), fourth[0]),
        b.add(b.add(first[1], inner[1]), fourth[1]),
    )
    x_next, v_next = moved(sixth, total)
    b.name(x_next, "x")
    b.name(v_next, "v")
    pull = b.multiply(stiffness, x)
    target = b.log("x.meas", 1, 1, Type((), METRE))
    starts = GraphBuilder()
    x_start = starts.log("x.meas", 0, 0, Type((), METRE))
    v_start = starts.parameter("v_start", Type((), SPEED))
    program = Program(
        name="spring_damper_rk4",
        sample_time=0.05,
        signals=(
            Signal("F", Role.INPUT, (), NEWTON, range=(-10.0, 10.0), doc="Force on the mass"),
            Signal("x.meas", Role.TARGET, (), METRE),
        ),
        parameters=(
            Parameter("mass", (), mass_unit, (1.7,), minimum=0.1, maximum=10.0),
            Parameter("damping", (), per_speed, (0.8,), minimum=0.0),
            Parameter("stiffness", (), per_metre, (12.0,), minimum=0.0, scale=10.0),
            Parameter("v_start", (), SPEED, (0.1,)),
        ),
        states=(
            State("x", (), METRE, Declared(), x_next, x_start, doc="Position"),
            State("v", (), SPEED, Declared(), v_next, v_start, doc="Speed"),
        ),
        step=b.graph(),
        start=starts.graph(),
        outputs=(Output("position", x), Output("spring_force", pull)),
        losses=(Loss("fit", Measure.MSE, x_next, target),),
    )
    return Sample(
        program,
        (),
        lambda rows, seed: {
            "F": 5 * wave(rows, seed),
            "x.meas": wave(rows, seed + 1),
        },
    )
