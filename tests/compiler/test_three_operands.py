"""`select` and `clamp` align three operands, also where the last one's window renames an axis."""

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.types import WINDOW, Axis, Type

JOINT, WINDOW_OF_3 = Axis("joint", 3), Axis(WINDOW, 3)


def test_all_operands_of_clamp_take_the_window_of_a_bound():
    b = GraphBuilder()
    x, low = b.signal("x", 0, 0, Type((JOINT,))), b.signal("low", 0, 0, Type((JOINT,)))
    high = b.signal("high", -2, 0, Type((WINDOW_OF_3,)))
    node = b.node(b.clamp(x, low, high))
    assert {b.type(arg).axes for arg in node.args} == {node.type.axes} == {(WINDOW_OF_3,)}


def test_all_operands_of_select_take_the_window_of_the_condition():
    b = GraphBuilder()
    x, y = b.signal("x", 0, 0, Type((JOINT,))), b.signal("y", 0, 0, Type((JOINT,)))
    past = b.signal("past", -2, 0, Type((WINDOW_OF_3,)))
    condition = b.compare(Relation.LESS, past, b.constant(0.0))
    node = b.node(b.select(condition, x, y))
    assert {b.type(arg).axes for arg in node.args} == {node.type.axes} == {(WINDOW_OF_3,)}
