"""Records of the operations that bring values into a graph: numbers, inputs, the log, memory."""

from __future__ import annotations

import numpy as np

from compiler.ir.ops import Window
from compiler.ir.program import History
from compiler.ir.types import WINDOW, Axis, Type
from tests.every_op.record import WINDOW_LENGTH, Record, RecordBuilder, windows_of
from tests.every_op.samples import BASIS, JOINT, SPECIAL, operand, smooth, with_special

T = Axis(WINDOW, WINDOW_LENGTH)


def _constant() -> Record:
    r = RecordBuilder()
    x = r.sample("x", operand(0, 3), (JOINT,))
    table = np.array([[0.5, -0.0], [1e-3, 3.0], [-7.25, 1e6]])
    r.expect("y", r.graph.constant(table, (JOINT, BASIS)), np.broadcast_to(table, (26, 3, 2)))
    r.expect("itself", x, r.logged("x"))  # gives the slopes of the outputs below a scale
    zeros = r.graph.constant((0.0, 0.0, 0.0), (JOINT,))
    with np.errstate(invalid="ignore"):
        r.expect("times_zero", r.graph.multiply(x, zeros), r.logged("x") * 0.0)
        r.expect("minus_itself", r.graph.subtract(x, x), r.logged("x") - r.logged("x"))
        r.expect("by_itself", r.graph.divide(x, x), r.logged("x") / r.logged("x"))
        none = np.where(np.isfinite(r.logged("x")), 0.0, np.nan).sum(1)
        r.expect("with_zeros", r.graph.contract(zeros, x), none)
        r.expect("of_zeros", r.graph.contract(x, zeros), none)
    return r.record("Constant")


def _read_parameter() -> Record:
    r = RecordBuilder()
    values = np.array([[0.5, -1.0, 2.0], [3.0, 0.25, -0.75]])
    x = r.sample("x", smooth(3))
    matrix = r.parameter("matrix", values, (BASIS, JOINT))
    r.expect("y", r.graph.multiply(x, matrix), r.logged("x")[:, None, None] * values)
    r.expect("bare", matrix, np.broadcast_to(values, (12, 2, 3)))
    return r.record("ReadParameter")


def _read_signal() -> Record:
    r = RecordBuilder()
    x = r.series("x", with_special(smooth(1, 3), SPECIAL), (JOINT,))
    late = r.series("late", with_special(smooth(2), SPECIAL))
    ahead = r.series("ahead", with_special(smooth(3, 2), SPECIAL), (BASIS,))
    both = r.series("both", with_special(smooth(4), SPECIAL))
    window = Axis(WINDOW, 2)

    def read(name: str, first: int, last: int, *axes: Axis) -> int:
        return r.graph.signal(name, first, last, Type(axes))

    r.expect("now", read("x", 0, 0, JOINT), x)
    r.expect("window", read("x", -3, 0, JOINT, T), windows_of(x, -3, 0))
    r.expect("inner", read("x", -2, -1, JOINT, window), windows_of(x, -2, -1))
    r.expect("of_one", read("x", 0, 0, JOINT, Axis(WINDOW, 1)), windows_of(x, 0, 0))
    r.expect("two_late", read("late", -2, -2), windows_of(late, -2, -2)[:, 0])
    r.expect("late_window", read("late", -3, -2, window), windows_of(late, -3, -2))
    r.expect("preview", read("ahead", 0, 1, BASIS, window), windows_of(ahead, 0, 1))
    r.expect("next", read("ahead", 1, 1, BASIS), windows_of(ahead, 1, 1)[..., 0])
    r.expect("around", read("both", -2, 1, T), windows_of(both, -2, 1))
    return r.record("ReadSignal")


def _read_log() -> Record:
    r = RecordBuilder()
    x = r.series("x", with_special(smooth(1, 3), SPECIAL), (JOINT,))
    starts = r.starts
    mean = starts.sum(starts.log("x", -2, 0, Type((JOINT, Axis(WINDOW, 3)))), WINDOW)
    ahead = starts.log("x", 1, 1, Type((JOINT,)))
    for name, start, values in (
        ("total", mean, windows_of(x, -2, 0).sum(-1)),
        ("ahead", ahead, windows_of(x, 1, 1)[..., 0]),
    ):
        value = r.graph.state(name, Type((JOINT,)))
        r.state(name, (JOINT,), r.graph.negate(value), start)
        r.expect(f"y_{name}", value, values)
        r.expect_next(name, -values)
    return r.record("ReadLog")


def _read_state() -> Record:
    r = RecordBuilder()
    u = r.sample("u", with_special(smooth(1), SPECIAL))
    level = r.graph.state("level", Type())
    grid = r.graph.state("grid", Type((BASIS, JOINT)))
    first = np.arange(6.0).reshape(2, 3)
    r.state("level", (), r.graph.add(level, u), r.starts.constant(2.5))
    r.state("grid", (BASIS, JOINT), grid, r.starts.constant(first, (BASIS, JOINT)))
    series = r.logged("u")
    r.expect("y", level, np.full(len(series), 2.5))
    r.expect("y_grid", grid, np.broadcast_to(first, (len(series), 2, 3)))
    r.expect_next("level", 2.5 + series)
    r.expect_next("grid", np.broadcast_to(first, (len(series), 2, 3)))
    return r.record("ReadState")


def _window() -> Record:
    r = RecordBuilder()
    series = r.series("x", with_special(smooth(1, 3), SPECIAL), (JOINT,))
    # twice the input is remembered, so that no read of the log can stand in for the buffer
    x = r.graph.signal("x", 0, 0, Type((JOINT,)))
    twice = r.graph.add(x, x)
    buffer = (JOINT, Axis(WINDOW, 3))
    window = r.graph.emit(Window("twice.history"), (twice,), Type((JOINT, T)))
    logged = r.starts.log("x", -3, -1, Type(buffer))
    kept = r.graph.slice(window, WINDOW, 1, WINDOW_LENGTH)
    start = r.starts.add(logged, logged)
    r.state("twice.history", buffer, kept, start, History("twice"))
    r.expect("y", window, 2 * windows_of(series, -3, 0))
    r.expect_next("twice.history", 2 * windows_of(series, -2, 0))
    return r.record("Window")


def leaf_records() -> dict[str, Record]:
    """Records by the name of the operation."""
    return {
        "Constant": _constant(),
        "ReadParameter": _read_parameter(),
        "ReadSignal": _read_signal(),
        "ReadLog": _read_log(),
        "ReadState": _read_state(),
        "Window": _window(),
    }
