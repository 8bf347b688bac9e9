"""A window that only one sum reads moves in the loop of that sum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.interface.interface import c_interface
from backends.c_lowering.sums import shifting_sums
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import assert_same_bits, built, golden, replay
from tests.language.compiled import compiled

ALONE = """
inputs: {u: {unit: 1, range: [-2, 2]}}
layers: {h: {fir: {window: 25, bias: true}}}
outputs: {y: h(u)}
"""
SUM = """
inputs: {u: {unit: 1, range: [-2, 2]}}
outputs: {y: "sum(u.past(11)) + u"}
"""
TWICE = """
inputs: {u: {unit: 1, range: [-2, 2]}}
layers: {h: {fir: {window: 9}}}
outputs: {y: "h(u) + u[t-8]"}
"""
SQUARES = """
inputs: {u: {unit: 1, range: [-2, 2]}}
outputs: {y: "u.past(9) @ u.past(9)"}
"""
ROWS = """
inputs: {u: {unit: 1, range: [-2, 2]}}
dims: {joint: 3}
layers: {h: {fir: {window: 9, out: joint}}}
outputs: {y: h(u)}
"""


def _moved(program: Program, unroll: int = 4) -> int:
    interface = c_interface(program, COptions(unroll=unroll))
    roots = [out.node for out in program.outputs] + [state.next for state in program.states]
    return len(shifting_sums(program.step, roots, interface.states, unroll))


@pytest.mark.parametrize(
    ("text", "count"), [(ALONE, 1), (SUM, 1), (TWICE, 0), (SQUARES, 0), (ROWS, 0)]
)
def test_only_a_single_reader_moves_a_window(text: str, count: int) -> None:
    assert _moved(to_step_form(compiled(text))) == count


@pytest.mark.parametrize("text", [ALONE, SUM, TWICE, SQUARES, ROWS])
@pytest.mark.parametrize("unroll", [1, 3, 4, 30])
def test_bits_and_memory_are_those_of_the_interpreter(
    text: str, unroll: int, tmp_path: Path
) -> None:
    program, options = to_step_form(compiled(text)), COptions(unroll=unroll)
    vectors = golden(program, options, 100, seed=2)
    step = built(program, tmp_path, options)
    outputs, status = replay(step, vectors)
    assert_same_bits(outputs, vectors.outputs)
    assert np.array_equal(status, vectors.status)


def test_what_is_written_out_needs_no_loop() -> None:
    assert _moved(to_step_form(compiled(ALONE)), unroll=30) == 0
