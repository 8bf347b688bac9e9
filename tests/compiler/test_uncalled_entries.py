"""The check of what nothing calls leaves nothing behind in the program."""

import pytest

from compiler.passes import run_passes
from tests.language.compiled import codes, compiled, warnings_of

HEAD = """\
    inputs: {u: {}}
    dims: {a: 2}
    parameters: {p: 0.5}
    outputs: {y: u}
    layers:
      phi: {fuzzify: {centers: [0, 1], dim: a}}
      sys: {state_space: {order: 1}}
"""


@pytest.mark.parametrize(
    "uncalled",
    [
        '      local: {local_model: {by: "phi(sys(p, p))", cell: {state_space: {order: 2}}}}',
        '      local: {local_model: {by: "phi(sys(p, p))", cell: {linear: {}}}}',
        '    functions: {f: {args: [v], expr: "sys(v, v)"}}',
        '    functions: {f: {args: [v, w], expr: "sys(v) + sys(v, w) + sys(w)"}}',
        '    functions: {f: {args: [v], expr: "integral(v) + sys(v) + sys([v, v])"}}',
    ],
)
def test_a_stateful_layer_in_what_nothing_calls_is_not_in_the_program(uncalled: str) -> None:
    program = compiled(HEAD + uncalled)
    assert run_passes(program) == program
    assert not program.states
    assert not program.parameters


def test_the_arrays_of_a_layer_are_of_its_calls_not_of_its_check() -> None:
    """Called with zeros the layer has one input, in the loss of an uncalled function two."""
    text = HEAD + '    functions: {f: {args: [v], expr: "sys(v, v)"}, g: {args: [v], expr: sys(v)}}'
    assert set(warnings_of(text)) == {"W0301"}


def test_a_past_that_nothing_fills_is_an_error_of_a_layer_that_nothing_calls() -> None:
    text = (
        HEAD
        + """\
      local: {local_model: {by: "phi(x[t-3])", cell: {linear: {}}}}
    states: {x: {next: 0.5 * x + u}}
"""
    )
    assert codes(text) == ["E0610"]
    assert codes(text.replace("0.5 * x + u}", "0.5 * x + u, history: 0}")) == []
