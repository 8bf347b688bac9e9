"""The sample program `fuzzy_local_models`."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Dimension, Loss, Measure, Output, Parameter, Program, Role, Signal
from compiler.ir.types import Axis, Prediction, Type
from tests.sample_programs.sample import (
    Sample,
    taps,
    wave,
)


def fuzzy_local_models() -> Sample:
    """v_next = tanh(Σᵢ φᵢ(v)·(wᵢ·v[t-2:t] + cᵢ·u[t-1])), φ triangular over three cells."""
    b = GraphBuilder()
    cell = Axis("cell", 3)
    v = b.signal("v", 0, 0, Type())
    distance = b.apply("abs", b.subtract(v, b.constant((-1.0, 0.0, 1.0), (cell,))))
    membership = b.maximum(b.subtract(b.constant(1.0), distance), b.constant(0.0))
    b.name(membership, "phi")
    past = b.signal("v", -2, 0, Type(taps(3)))
    weights = b.parameter("model.weight", Type((cell, *taps(3))))
    pushed = b.multiply(b.parameter("model.gain", Type((cell,))), b.signal("u", -1, -1, Type()))
    models = b.add(b.contract(weights, past), pushed)
    b.name(models, "model")
    v_next = b.apply("tanh", b.sum(b.multiply(membership, models), "cell"))
    b.name(v_next, "v_next")
    clipped = b.clamp(v_next, b.constant(-0.9), b.constant(0.9))
    target = b.log("v", 1, 1, Type())
    program = Program(
        name="fuzzy_local_models",
        sample_time=0.01,
        signals=(
            Signal("v", Role.INPUT, range=(-1.2, 1.2)),
            Signal("u", Role.INPUT, range=(-2.0, 2.0)),
        ),
        parameters=(
            Parameter(
                "model.weight",
                (cell, *taps(3)),
                None,
                (0.1, -0.3, 0.8, 0.2, -0.5, 1.1, 0.05, -0.2, 0.9),
            ),
            Parameter("model.gain", (cell,), None, (0.3, 0.1, 0.2)),
        ),
        states=(),
        step=b.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("v_next", v_next, Prediction("v", 1)), Output("v_shown", clipped)),
        losses=(Loss("v_next", Measure.MSE, v_next, target),),
        dimensions=(Dimension("cell", 3, ("low", "middle", "high")),),
    )
    return Sample(
        program,
        ("v",),
        lambda rows, seed: {
            "v": 0.6 * wave(rows, seed),
            "u": wave(rows, seed + 1),
        },
    )
