"""Orders of evaluation: the graph's own where it can stay, cycles from cause to effect."""

from __future__ import annotations

import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import CycleError, evaluation_order
from compiler.ir.types import Type


def test_order_stays_where_it_can() -> None:
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    for _ in range(5):
        x = b.negate(x)
    assert evaluation_order(b.graph(), {}) == [0, 1, 2, 3, 4, 5]


def test_fed_reader_comes_after_what_feeds_it() -> None:
    b = GraphBuilder()
    reader = b.signal("u", 0, 0, Type())
    user = b.negate(reader)
    other = b.signal("x", 0, 0, Type())
    feed = b.apply("sin", other)
    assert evaluation_order(b.graph(), {reader: feed}) == [other, feed, reader, user]


def test_value_needed_twice_is_placed_once() -> None:
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    root = b.apply("sin", x)
    both = b.add(b.negate(root), b.multiply(root, root))
    order = evaluation_order(b.graph(), {})
    assert sorted(order) == list(range(len(b.graph())))
    assert order.index(root) < order.index(both)


def test_cycle_is_listed_each_before_its_user() -> None:
    b = GraphBuilder()
    reader = b.signal("u", 0, 0, Type())
    first = b.negate(reader)
    second = b.apply("sin", first)
    b.apply("cos", second)
    with pytest.raises(CycleError) as raised:
        evaluation_order(b.graph(), {reader: second})
    assert raised.value.nodes == (first, second, reader)
