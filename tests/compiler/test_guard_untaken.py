"""The guard of untaken branches changes no value, only arguments that no branch takes."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Apply, Constant, Divide, Relation, Select
from compiler.ir.program import NodeId, Output, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.guard_derivatives import guard_untaken
from tests.programs import SAMPLES

LOG = {"x": np.array([-2.0, -0.0, 0.0, 0.5, 3.0, np.nan]), "y": np.array([1.0, -1, 0, 2, -3, 1])}


class Draft:
    """A program over the inputs x and y, with a condition x > 0 and another y > 0."""

    def __init__(self) -> None:
        self.b = GraphBuilder()
        self.x = self.b.signal("x", 0, 0, Type())
        self.y = self.b.signal("y", 0, 0, Type())
        zero = self.b.constant(0.0)
        self.x_positive = self.b.compare(Relation.GREATER, self.x, zero)
        self.y_positive = self.b.compare(Relation.GREATER, self.y, zero)
        self.zero = zero

    def program(self, *outputs: NodeId) -> Program:
        named = tuple(Output(f"o{i}", node) for i, node in enumerate(outputs))
        inputs = (Signal("x", Role.INPUT), Signal("y", Role.INPUT))
        nothing = GraphBuilder().graph()
        return Program("guard", None, inputs, (), (), self.b.graph(), nothing, named)


def guards_of(program: Program, op: Apply | Divide) -> list[int]:
    """For every node with this operation the number of selects right before its last argument."""
    step, counts = program.step, list[int]()
    for _, node in step:
        if node.op == op:
            argument, count = step[node.args[-1]], 0
            while isinstance(argument.op, Select):
                count += 1
                argument = next(
                    n
                    for n in (step[a] for a in argument.args[1:])
                    if not (isinstance(n.op, Constant) and n.op.values == (0.5,))
                )
            counts.append(count)
    return counts


def assert_same_values(program: Program, guarded: Program) -> None:
    rows = np.arange(len(LOG["x"]))
    expected = Interpreter(program).step(LOG, rows, {}).outputs
    found = Interpreter(guarded).step(LOG, rows, {}).outputs
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name], value)


def test_a_value_of_one_branch_is_guarded():
    d = Draft()
    root = d.b.apply("sqrt", d.x)
    program = d.program(d.b.select(d.x_positive, d.b.multiply(root, d.y), d.zero))
    guarded = guard_untaken(program)
    assert guards_of(guarded, Apply("sqrt")) == [1]
    assert_same_values(program, guarded)


def test_a_value_that_is_used_elsewhere_stays():
    d = Draft()
    root = d.b.apply("sqrt", d.x)
    program = d.program(d.b.select(d.x_positive, root, d.zero), root)
    guarded = guard_untaken(program)
    assert guards_of(guarded, Apply("sqrt")) == [0]
    assert_same_values(program, guarded)


def test_a_nest_guards_by_all_of_its_conditions():
    d = Draft()
    inner = d.b.select(d.y_positive, d.b.divide(d.y, d.x), d.y)
    program = d.program(d.b.select(d.x_positive, inner, d.zero))
    guarded = guard_untaken(program)
    assert guards_of(guarded, Divide()) == [2]
    assert_same_values(program, guarded)


def test_two_branches_guard_by_what_they_share():
    d = Draft()
    root = d.b.apply("log", d.x)
    first = d.b.select(d.y_positive, root, d.zero)
    second = d.b.select(d.y_positive, d.zero, root)
    both = d.b.select(d.x_positive, d.b.add(first, second), d.zero)
    guarded = guard_untaken(d.program(both))
    assert guards_of(guarded, Apply("log")) == [1]
    assert_same_values(d.program(both), guarded)


def test_a_condition_that_stands_after_the_value_is_moved_before_it():
    d = Draft()
    root = d.b.apply("sqrt", d.x)
    late = d.b.compare(Relation.LESS, d.b.constant(0.0), d.x)
    program = d.program(d.b.select(late, root, d.zero))
    guarded = guard_untaken(program)
    assert guards_of(guarded, Apply("sqrt")) == [1]
    for index, node in guarded.step:
        assert all(arg < index for arg in node.args)
    assert_same_values(program, guarded)


def test_a_condition_made_of_the_value_does_not_guard_it():
    d = Draft()
    root = d.b.apply("sqrt", d.x)
    large = d.b.compare(Relation.GREATER, root, d.b.constant(1.0))
    program = d.program(d.b.select(large, root, d.zero))
    guarded = guard_untaken(program)
    assert guards_of(guarded, Apply("sqrt")) == [0]
    assert_same_values(program, guarded)


@pytest.mark.parametrize("name", SAMPLES)
def test_sample_programs_keep_their_values(name: str):
    sample = SAMPLES[name]()
    guarded = guard_untaken(sample.program)
    log, times = sample.log(40, 2), np.arange(8, 30)
    judge, other = Interpreter(sample.program), Interpreter(guarded)
    expected = judge.step(log, times, judge.start(log, times), losses=False)
    found = other.step(log, times, other.start(log, times), losses=False)
    for output, value in expected.outputs.items():
        np.testing.assert_array_equal(found.outputs[output], value)
