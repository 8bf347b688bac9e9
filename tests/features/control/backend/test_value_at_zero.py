"""Values of a stage without the sums that steady slopes know."""

from __future__ import annotations

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.types import WINDOW, Axis, Type
from msnn.features.control.backend.stage_code.stage_graphs import values_at_zero

PAST = Type((Axis(WINDOW, 3),))


def _filter() -> tuple[GraphBuilder, int, int]:
    """y = Σ w · [past, u], and the samples that it sums."""
    b = GraphBuilder()
    u = b.reshape(b.signal("u", 0, 0, Type(())), (Axis(WINDOW, 1),))
    samples = b.concat([b.state("past", PAST), u], WINDOW)
    weights = b.constant((1.0, 2.0, 3.0, 4.0), (Axis(WINDOW, 4),), None)
    return b, b.contract(weights, samples), samples


def test_a_sum_goes_without_the_samples_that_are_zero() -> None:
    b, y, _ = _filter()
    found = values_at_zero(b.graph(), [y], [], {"past": (True, True, True)})
    assert found is not None
    graph, _ = found
    assert not any(isinstance(node.op, ops.ReadState) for _, node in graph)
    constants = [node.op.values for _, node in graph if isinstance(node.op, ops.Constant)]
    assert (4.0,) in constants


def test_a_sum_keeps_the_samples_that_are_not() -> None:
    b, y, _ = _filter()
    found = values_at_zero(b.graph(), [y], [], {"past": (True, True, False)})
    assert found is not None
    graph, _ = found
    slices = [node.op for _, node in graph if isinstance(node.op, ops.Slice)]
    assert slices == [ops.Slice(WINDOW, 2, 3)]


def test_rows_go_without_the_samples_that_are_zero_in_all_of_them() -> None:
    b = GraphBuilder()
    axes = (Axis("j", 2), Axis(WINDOW, 3))
    past = b.state("past", Type(axes))
    y = b.contract(b.constant((1.0, 2.0, 3.0), axes[1:], None), past)
    found = values_at_zero(b.graph(), [y], [], {"past": (True, True, False) * 2})
    assert found is not None
    slices = [node.op for _, node in found[0] if isinstance(node.op, ops.Slice)]
    assert slices == [ops.Slice(WINDOW, 2, 3)]
    assert (
        values_at_zero(b.graph(), [y], [], {"past": (True, True, False, False, False, True)})
        is None
    )


def test_what_slopes_take_over_is_not_changed() -> None:
    b, y, samples = _filter()
    zeros = {"past": (True, True, True)}
    assert values_at_zero(b.graph(), [y, samples], [samples], zeros) is None


def test_sums_that_cannot_be_split_stay_whole() -> None:
    b, _, samples = _filter()
    y = b.sum(b.apply("exp", samples), WINDOW)
    assert values_at_zero(b.graph(), [y], [], {"past": (True, True, True)}) is None
