"""The sample program `joint_arm`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Dimension, Loss, Measure, Output, Parameter, Program, Role, Signal
from compiler.ir.types import WINDOW, Axis, Prediction, Type
from tests.sample_programs.sample import (
    RADIAN,
    TORQUE,
    Sample,
    taps,
    wave,
)


def joint_arm() -> Sample:
    """Vectors over joints: taps a joint, a coupling matrix, an outer product and a permutation."""
    b = GraphBuilder()
    joint, basis, other = Axis("joint", 3), Axis("basis", 2), Axis("joint_2", 3)
    q_past = b.signal("q", -3, 0, Type((joint, *taps(4)), RADIAN))
    own = b.contract(b.parameter("own.weight", Type((joint, *taps(4)))), q_past)
    torque = b.signal("tau", 0, 0, Type((joint,), TORQUE))
    coupling = b.parameter("coupling", Type((other, joint), RADIAN / TORQUE))
    coupled = b.rename(b.contract(coupling, torque), "joint_2", "joint")
    now = b.element(q_past, WINDOW, 3)
    waves = b.apply("sin", b.multiply(now, b.constant((1.0, 2.0), (basis,))))
    shape = b.parameter("shape", Type((basis, joint)))
    weighed = b.multiply(b.broadcast(waves, (basis, joint)), shape)
    gravity = b.sum(weighed, "basis")
    q_next = b.add(b.add(own, coupled), gravity)
    b.name(q_next, "q_next")
    first = b.slice(q_next, "joint", 0, 1)
    rest = b.negate(b.slice(q_next, "joint", 1, 3))
    mirrored = b.concat([rest, first], "joint")
    far = b.compare(Relation.GREATER, b.apply("abs", q_next), b.constant(0.5, unit=RADIAN))
    shown = b.select(far, mirrored, q_next)
    target = b.log("q", 1, 1, Type((joint,), RADIAN))
    program = Program(
        name="joint_arm",
        sample_time=0.001,
        signals=(
            Signal("q", Role.INPUT, (joint,), RADIAN, range=(-3.0, 3.0), doc="Joint angles"),
            Signal("tau", Role.INPUT, (joint,), TORQUE, range=(-5.0, 5.0)),
        ),
        parameters=(
            Parameter(
                "own.weight",
                (joint, *taps(4)),
                None,
                (0.1, -0.2, 0.15, 0.7, 0.05, 0.02, -0.1, 0.8, -0.05, 0.1, 0.2, 0.6),
            ),
            Parameter(
                "coupling",
                (other, joint),
                RADIAN / TORQUE,
                (0.1, 0.02, 0.0, 0.02, 0.12, -0.03, 0.01, -0.02, 0.09),
            ),
            Parameter("shape", (basis, joint), None, (0.05, -0.02, 0.04, 0.01, 0.03, -0.02)),
        ),
        states=(),
        step=b.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("q_next", q_next, Prediction("q", 1)), Output("q_shown", shown)),
        losses=(Loss("q_next", Measure.MSE, q_next, target),),
        dimensions=(
            Dimension("joint", 3, ("base", "elbow", "wrist")),
            Dimension("basis", 2),
            Dimension("joint_2", 3),
        ),
    )
    return Sample(
        program,
        ("q",),
        lambda rows, seed: {
            "q": 0.5 * wave(rows, seed, 3),
            "tau": wave(rows, seed + 1, 3),
        },
    )
