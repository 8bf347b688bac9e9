"""Specs with thousands of equations that need each other in a row are compiled, or refused."""

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from tests.language.compiled import codes, compiled

COUNT = 2000


def chain(first: str, step: str = "e{before} + u") -> str:
    lines = [f"  e0: {first}", *(f"  e{i}: {step.format(before=i - 1)}" for i in range(1, COUNT))]
    # the last one stands first, so that each is lowered inside the one before
    equations = "\n".join(reversed(lines))
    return f"inputs: {{u: 1}}\nequations:\n{equations}\noutputs: {{y: e{COUNT - 1}}}\n"


@pytest.mark.parametrize("step", ["e{before} + u", "((((e{before}) + u) * 1 + 0) * 1 + 0)"])
def test_a_long_chain_of_equations(step: str) -> None:
    interpreter = Interpreter(compiled(chain("u", step)))
    series, rows = {"u": np.ones(1)}, np.array([0])
    outputs = interpreter.step(series, rows, interpreter.start(series, rows)).outputs
    assert outputs["y"][0] == COUNT


def test_a_long_algebraic_loop_is_one_diagnostic() -> None:
    assert codes(chain(f"e{COUNT - 1}")) == ["E0702"]


def test_a_long_chain_in_the_past() -> None:
    text = chain("u").replace(f"y: e{COUNT - 1}", f'y: "e{COUNT - 1}[t-1]"')
    interpreter = Interpreter(compiled(text))
    series, rows = {"u": np.array([1.0, 5.0])}, np.array([1])
    outputs = interpreter.step(series, rows, interpreter.start(series, rows)).outputs
    assert outputs["y"][0] == COUNT
