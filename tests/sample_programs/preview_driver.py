"""The sample program `preview_driver`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Loss, Measure, Output, Parameter, Program, Role, Signal
from compiler.ir.types import Prediction, Type
from tests.sample_programs.sample import (
    Sample,
    taps,
    wave,
)


def preview_driver() -> Sample:
    """A steering command from the road ahead; `command` predicts u[t] itself (ahead 0)."""
    b = GraphBuilder()
    ahead = b.signal("road", -1, 3, Type(taps(5)))
    b.name(ahead, "road_around")
    now = b.signal("road", 0, 0, Type())
    before = b.signal("u", -3, -1, Type(taps(3)))
    look = b.contract(b.parameter("look.weight", Type(taps(5))), ahead)
    habit = b.contract(b.parameter("habit.weight", Type(taps(3))), before)
    command = b.add(look, habit)
    b.name(command, "command")
    around = b.signal("u", -2, 0, Type(taps(3)))
    turned = b.contract(b.parameter("turn.weight", Type(taps(3))), around)
    error = b.subtract(b.add(turned, b.signal("u", 0, 0, Type())), now)
    b.name(error, "error")
    target = b.log("u", 0, 0, Type())
    program = Program(
        name="preview_driver",
        sample_time=0.1,
        signals=(Signal("road", Role.INPUT), Signal("u", Role.INPUT, range=(-4.0, 4.0))),
        parameters=(
            Parameter("look.weight", taps(5), None, (-0.1, 0.3, 0.25, 0.15, 0.05)),
            Parameter("habit.weight", taps(3), None, (0.05, -0.1, 0.4)),
            Parameter("turn.weight", taps(3), None, (0.2, 0.3, 0.5)),
        ),
        states=(),
        step=b.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("command", command, Prediction("u", 0)), Output("error", error)),
        losses=(Loss("command", Measure.RMSE, command, target),),
    )
    return Sample(
        program,
        ("u",),
        lambda rows, seed: {
            "road": wave(rows, seed),
            "u": wave(rows, seed + 1),
        },
    )
