"""Records of the operations that change axes or sum along them."""

from __future__ import annotations

import numpy as np

from compiler.ir.ops import Contract, Relation
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type
from tests.every_op.record import WINDOW_LENGTH, Array, Record, RecordBuilder, windows_of
from tests.every_op.samples import BASIS, JOINT, SPECIAL, WHEEL, smooth, with_special

T = Axis(WINDOW, WINDOW_LENGTH)


def _broadcast() -> Record:
    r = RecordBuilder()
    scalar = r.sample("scalar", with_special(smooth(1), SPECIAL))
    joint = r.sample("joint_value", with_special(smooth(2, 3), SPECIAL), (JOINT,))
    grid = r.sample("grid", with_special(smooth(3, 3, 4), SPECIAL), (JOINT, WHEEL))
    s, j, g = r.logged("scalar"), r.logged("joint_value"), r.logged("grid")
    b = r.graph
    rows = len(s)
    to = b.broadcast
    r.expect("up", to(scalar, (JOINT, T)), np.broadcast_to(s[:, None, None], (rows, 3, 4)))
    r.expect("last", to(joint, (BASIS, JOINT)), np.broadcast_to(j[:, None], (rows, 2, 3)))
    r.expect("first", to(joint, (JOINT, BASIS)), np.broadcast_to(j[..., None], (rows, 3, 2)))
    r.expect("swapped", to(grid, (WHEEL, JOINT)), g.transpose(0, 2, 1))
    between = np.broadcast_to(g.transpose(0, 2, 1)[:, :, None], (rows, 4, 2, 3))
    r.expect("between", to(grid, (WHEEL, BASIS, JOINT)), between)
    windows = np.broadcast_to(windows_of(j, -3, 0)[:, :, None], (rows, 3, 2, 4))
    r.expect("window", to(r.past("joint_value"), (JOINT, BASIS, T)), windows)
    condition = b.broadcast(b.compare(Relation.LESS, joint, b.constant(0.5)), (BASIS, JOINT))
    chosen = b.select(condition, b.constant(1.0), b.constant(0.0))
    r.expect("bools", chosen, np.broadcast_to((j < 0.5).astype(float)[:, None], (rows, 2, 3)))
    return r.record("Broadcast")


def _reshape() -> Record:
    r = RecordBuilder()
    grid = r.sample("grid", with_special(smooth(1, 3, 4), SPECIAL), (JOINT, WHEEL))
    r.sample("joint_value", with_special(smooth(2, 3), SPECIAL), (JOINT,))
    g, j = r.logged("grid"), r.logged("joint_value")
    b, rows = r.graph, len(g)
    r.expect("flat", b.reshape(grid, (Axis(UNNAMED, 12),)), g.reshape(rows, 12))
    r.expect("other", b.reshape(grid, (WHEEL, JOINT)), g.reshape(rows, 4, 3))
    r.expect("more", b.reshape(grid, (BASIS, JOINT, BASIS_2)), g.reshape(rows, 2, 3, 2))
    r.expect("renamed", b.rename(grid, "wheel", WINDOW), g)
    r.expect("to_window", b.rename(grid, "joint", WINDOW), g.transpose(0, 2, 1))
    past = b.reshape(r.past("joint_value"), (Axis(UNNAMED, 12),))
    r.expect("flat_window", past, windows_of(j, -3, 0).reshape(rows, 12))
    one = b.element(b.element(grid, "joint", 1), "wheel", 2)
    r.expect("one", one, g[:, 1, 2])
    r.expect("of_one", b.reshape(one, (Axis(UNNAMED, 1),)), g[:, 1, 2:3])
    return r.record("Reshape")


def _slice() -> Record:
    r = RecordBuilder()
    grid = r.sample("grid", with_special(smooth(1, 3, 4), SPECIAL), (JOINT, WHEEL))
    r.sample("joint_value", with_special(smooth(2, 3), SPECIAL), (JOINT,))
    g, j = r.logged("grid"), r.logged("joint_value")
    b = r.graph
    r.expect("first_axis", b.slice(grid, "joint", 1, 3), g[:, 1:3])
    r.expect("last_axis", b.slice(grid, "wheel", 1, 2), g[:, :, 1:2])
    r.expect("corner", b.slice(b.slice(grid, "wheel", 2, 4), "joint", 0, 1), g[:, :1, 2:])
    past = b.slice(r.past("joint_value"), WINDOW, 1, 3)
    r.expect("window", past, windows_of(j, -3, 0)[..., 1:3])
    return r.record("Slice")


def _concat() -> Record:
    r = RecordBuilder()
    one = r.sample("one", with_special(smooth(1, 3, 4), SPECIAL), (JOINT, WHEEL))
    short = r.sample("short", with_special(smooth(2, 2, 4), SPECIAL[::-1]), (SHORT, WHEEL))
    r.series("past", with_special(smooth(3, 3), SPECIAL), (JOINT,))
    x, y, w = r.logged("one"), r.logged("short"), windows_of(r.logged("past"), -3, 0)
    b = r.graph
    r.expect("first_axis", b.concat([one, short, one], "joint"), np.concatenate([x, y, x], 1))
    r.expect("last_axis", b.concat([one, one], "wheel"), np.concatenate([x, x], 2))
    r.expect("alone", b.concat([one], "joint"), x)
    twice = b.add(r.past("past"), r.past("past"))
    windows = b.concat([r.past("past"), twice], WINDOW)
    r.expect("windows", windows, np.concatenate([w, 2 * w], -1))
    return r.record("Concat")


def _sum() -> Record:
    r = RecordBuilder()
    grid = r.sample("grid", with_special(smooth(1, 3, 4), SPECIAL), (JOINT, WHEEL))
    r.sample("joint_value", with_special(smooth(2, 3), SPECIAL), (JOINT,))
    r.sample("alone", with_special(smooth(3), SPECIAL))
    g, j, a = r.logged("grid"), r.logged("joint_value"), r.logged("alone")
    b = r.graph
    r.expect("first_axis", b.sum(grid, "joint"), np.einsum("bjw->bw", g))
    r.expect("last_axis", b.sum(grid, "wheel"), np.einsum("bjw->bj", g))
    r.expect("all", b.sum(b.sum(grid, "wheel"), "joint"), np.einsum("bjw->b", g))
    r.expect("window", b.sum(r.past("alone"), WINDOW), windows_of(a, -3, 0).sum(-1))
    joints = b.sum(r.past("joint_value"), WINDOW)
    r.expect("joint_window", joints, windows_of(j, -3, 0).sum(-1))
    return r.record("Sum")


def _contract() -> Record:
    r = RecordBuilder()
    b = r.graph
    named: dict[str, Array] = {}

    def make(name: str, seed: int, *axes: Axis) -> int:
        shape = tuple(axis.size for axis in axes)
        node = r.sample(name, with_special(smooth(seed, *shape), SPECIAL), axes)
        named[name] = r.logged(name)
        return node

    def expect(name: str, left: int, right: int, axis: str, result: tuple[Axis, ...], sums: str):
        first, second, _ = sums.replace("->", ",").split(",")
        operands = [named[key] for key in (names[left], names[right])]
        values = np.einsum(f"z{first},z{second}->z{sums.split('->')[1]}", *operands)
        r.expect(name, b.emit(Contract(axis), (left, right), Type(result)), values)

    vector, other = make("vector", 1, JOINT), make("other", 2, JOINT)
    grid, turned = make("grid", 3, JOINT, WHEEL), make("turned", 4, WHEEL, JOINT)
    block = make("block", 5, BASIS, JOINT, WHEEL)
    wheel = make("wheel_value", 6, WHEEL)
    names = {
        vector: "vector",
        other: "other",
        grid: "grid",
        turned: "turned",
        block: "block",
        wheel: "wheel_value",
    }
    expect("dot", vector, other, "joint", (), "j,j->")
    expect("matrix_vector", grid, wheel, "wheel", (JOINT,), "jw,w->j")
    expect("vector_matrix", vector, grid, "joint", (WHEEL,), "j,jw->w")
    expect("first_axis", grid, vector, "joint", (WHEEL,), "jw,j->w")
    expect("aligned", grid, turned, "wheel", (JOINT,), "jw,wj->j")
    expect("stacked", block, grid, "wheel", (BASIS, JOINT), "njw,jw->nj")
    expect("stacked_swapped", block, grid, "joint", (WHEEL, BASIS), "njw,jw->wn")
    expect("outer", block, vector, "joint", (WHEEL, BASIS), "njw,j->wn")
    expect("right_first", wheel, block, "wheel", (JOINT, BASIS), "w,njw->jn")
    taps = r.parameter("taps", TAPS, (JOINT, T))
    windows = windows_of(named["vector"], -3, 0)
    own = b.contract(taps, r.past("vector"))
    r.expect("taps", own, np.einsum("jt,zjt->zj", TAPS, windows))
    mixed = b.contract(r.parameter("mix", MIX, (BASIS, JOINT)), r.past("vector"))
    r.expect("mixed", mixed, np.einsum("nj,zjt->znt", MIX, windows))
    return r.record("Contract")


BASIS_2, SHORT = Axis("basis_2", 2), Axis("joint", 2)
TAPS = np.linspace(-1.0, 1.2, 12).reshape(3, 4)
MIX = np.array([[0.5, -1.0, 0.25], [2.0, 0.125, -0.75]])


def axes_records() -> dict[str, Record]:
    """Records by the name of the operation."""
    with np.errstate(invalid="ignore"):
        return {
            "Broadcast": _broadcast(),
            "Reshape": _reshape(),
            "Slice": _slice(),
            "Concat": _concat(),
            "Sum": _sum(),
            "Contract": _contract(),
        }
