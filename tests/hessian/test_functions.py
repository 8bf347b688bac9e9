"""Second slopes of the scalar functions against mpmath at fifty digits."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp

from compiler.hessian.curvature import second_slopes
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Output, Program, Role, Signal
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Type
from tests.kernels.references import EXACT

NAMES = ("a", "b")
TOLERANCE = 1e-10
"""Of the largest: 1 − tanh² and 1 − x² cancel up to five digits where they are small."""


@pytest.mark.parametrize("function", EXACT)
def test_second_slopes_are_exact(function: str) -> None:
    row = SCALAR_FUNCTIONS[function]
    names = NAMES[: row.arity]
    builder = GraphBuilder()
    arguments = [builder.signal(name, 0, 0, Type()) for name in names]
    slopes = second_slopes(builder, builder.apply(function, *arguments))
    program = Program(
        name=function,
        sample_time=None,
        signals=tuple(Signal(name, Role.INPUT, (), None) for name in names),
        parameters=(),
        states=(),
        step=builder.graph(),
        start=GraphBuilder().graph(),
        outputs=tuple(Output(f"{i}{j}", node) for (i, j), node in slopes.items()),
    )
    random = np.random.default_rng(2)
    # where 1 − tanh² has lost all its digits there is nothing to compare
    domain = [(max(low, -8.0), min(high, 8.0)) for low, high in row.domain]
    log = {name: random.uniform(*edge, 40) for name, edge in zip(names, domain, strict=True)}
    found = Interpreter(program).step(log, np.arange(40), {}).outputs
    for i, j in slopes:
        order = tuple((i == n) + (j == n) for n in arguments)
        with mp.workdps(50):
            exact = np.array(
                [
                    float(mp.diff(EXACT[function], *((point, order) if point[1:] else (*point, 2))))
                    for point in zip(*log.values(), strict=True)
                ]
            )
        np.testing.assert_allclose(
            found[f"{i}{j}"], exact, rtol=1e-9, atol=TOLERANCE * np.abs(exact).max()
        )
