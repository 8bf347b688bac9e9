"""Results that are kept for the same objects."""

from __future__ import annotations

from compiler.ir.kept_results import kept_for_same


def test_the_same_object_is_answered_once_and_an_equal_one_anew():
    asked: list[object] = []

    @kept_for_same(2)
    def doubled(values: tuple[float, ...], name: str) -> tuple[float, ...]:
        asked.append((values, name))
        return tuple(2 * value for value in values)

    zero, minus = (0.0,), (-0.0,)
    assert zero == minus
    assert str(doubled(zero, "a")) == str(doubled(zero, "a")) == "(0.0,)"
    assert str(doubled(minus, "a")) == "(-0.0,)"
    assert len(asked) == 2
    doubled(zero, "b")  # the oldest leaves
    doubled(zero, "a")
    assert len(asked) == 4
