"""Draws small well-typed programs: values of all layouts, combined by operations drawn at random.

Values stay within some ten units, so that programs of any length are well conditioned, and
conditions compare inputs with odd numbers, so that no rounding can change a branch.
"""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import strategies as st

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Contract, Relation
from compiler.ir.program import Declared, NodeId, Output, Parameter, Program, Role, Signal, State
from compiler.ir.rules import AxisConflict
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type, in_order

JOINT, BASIS = Axis("joint", 3), Axis("basis", 2)
LARGEST = 48
"""Elements of a value at most."""

Draw = Callable[..., int]


class _Pool:
    """The values drawn so far, and the operations that make one more of some of them."""

    def __init__(self, draw: Callable[[st.SearchStrategy[int]], int]) -> None:
        self._draw = draw
        self.b = GraphBuilder()
        self.inputs = [
            self.b.signal("u", 0, 0, Type()),
            self.b.signal("q", 0, 0, Type((JOINT,))),
        ]
        self.state = self.b.state("x", Type((JOINT,)))
        self.values = [
            *self.inputs,
            self.state,
            self.b.signal("u", -3, -1, Type((Axis(WINDOW, 3),))),
            self.b.signal("q", -2, 0, Type((JOINT, Axis(WINDOW, 3)))),
            self.b.parameter("gain", Type()),
            self.b.parameter("mix", Type((BASIS, JOINT))),
            self.b.constant((0.3, -0.8, 0.5), (Axis(UNNAMED, 3),)),
        ]

    def choose(self, count: int) -> int:
        return self._draw(st.integers(0, count - 1))

    def any(self) -> NodeId:
        return self.values[self.choose(len(self.values))]

    def grow(self) -> None:
        """One more value; none where the operands drawn do not fit together."""
        makers = (
            self._sum,
            self._product,
            self._quotient,
            self._extreme,
            self._clamped,
            self._selected,
            self._function,
            self._reduced,
            self._contracted,
            self._part,
            self._joined,
            self._turned,
        )
        try:
            value = makers[self.choose(len(makers))](self.any())
        except AxisConflict:
            return
        if self.b.type(value).size <= LARGEST:
            self.values.append(value)

    def _sum(self, a: NodeId) -> NodeId:
        operate = (self.b.add, self.b.subtract)[self.choose(2)]
        return self.b.multiply(operate(a, self.any()), self.b.constant(0.5))

    def _product(self, a: NodeId) -> NodeId:
        return self.b.multiply(a, self.b.apply("sin", self.any()))

    def _quotient(self, a: NodeId) -> NodeId:
        below = self.any()
        return self.b.divide(a, self.b.add(self.b.constant(1.0), self.b.multiply(below, below)))

    def _extreme(self, a: NodeId) -> NodeId:
        return (self.b.minimum, self.b.maximum)[self.choose(2)](a, self.any())

    def _clamped(self, a: NodeId) -> NodeId:
        return self.b.clamp(a, self.b.constant(-0.71), self.b.apply("abs", self.any()))

    def _selected(self, a: NodeId) -> NodeId:
        relation = list(Relation)[self.choose(len(Relation))]
        source = self.inputs[self.choose(len(self.inputs))]
        condition = self.b.compare(relation, source, self.b.constant(0.123456789))
        root = self.b.apply("sqrt", source)  # NaN in the branch that a negative source leaves
        taken = self.b.select(
            self.b.compare(Relation.GREATER, source, self.b.constant(0.0987654321)), root, source
        )
        return self.b.select(condition, self.b.add(a, taken), self.any())

    def _function(self, a: NodeId) -> NodeId:
        names = ("sin", "cos", "tanh", "sigmoid", "softplus", "atan", "abs")
        name = names[self.choose(len(names) + 1) - 1]
        return self.b.apply(name, self.b.negate(a))

    def _reduced(self, a: NodeId) -> NodeId:
        axes = self.b.type(a).axes
        return self.b.sum(a, axes[self.choose(len(axes))].name) if axes else self.b.negate(a)

    def _contracted(self, a: NodeId) -> NodeId:
        other = self.any()
        left, right = self.b.type(a).axes, self.b.type(other).axes
        shared = [axis for axis in left if axis in right]
        if not shared:
            return self.b.contract(a, other)
        along = shared[self.choose(len(shared))]
        names = {axis.name for axis in left}
        if any(axis.name in names and axis not in shared for axis in right):
            raise AxisConflict(left, right, "unequal lengths")
        axes = [axis for axis in left if axis != along]
        axes += [axis for axis in right if axis.name not in names]
        result = in_order(tuple(axes))
        return self.b.emit(Contract(along.name), (a, other), Type(result))

    def _part(self, a: NodeId) -> NodeId:
        axes = self.b.type(a).axes
        if not axes:
            return self.b.negate(a)
        axis = axes[self.choose(len(axes))]
        if axis.name not in (WINDOW, UNNAMED):  # a named dim has one size in a program
            return self.b.element(a, axis.name, self.choose(axis.size))
        start = self.choose(axis.size)
        return self.b.slice(a, axis.name, start, start + 1 + self.choose(axis.size - start))

    def _joined(self, a: NodeId) -> NodeId:
        axes = self.b.type(a).axes
        if not axes or axes[-1].name not in (WINDOW, UNNAMED):
            return self.b.negate(a)
        return self.b.concat([a, self.b.apply("tanh", a)], axes[-1].name)

    def _turned(self, a: NodeId) -> NodeId:
        """Named axes in another order, or everything as one unnamed axis."""
        axes = self.b.type(a).axes
        named = [axis for axis in axes if axis.name != WINDOW]
        if len(named) > 1:
            return self.b.broadcast(a, in_order((*reversed(named), *axes[len(named) :])))
        return self.b.reshape(a, (Axis(UNNAMED, self.b.type(a).size),))


@st.composite
def programs(draw: Callable[[st.SearchStrategy[int]], int]) -> Program:
    """Programs over the inputs u and q, a state x and two parameters, in window form."""
    pool = _Pool(draw)
    for _ in range(draw(st.integers(1, 24))):
        pool.grow()
    b = pool.b
    results = pool.values[-3:]
    follower = b.broadcast(_one_sample(pool, results[-1]), (JOINT,))
    starts = GraphBuilder()
    first = starts.sum(starts.log("q", -1, 0, Type((JOINT, Axis(WINDOW, 2)))), WINDOW)
    return Program(
        name="random",
        sample_time=0.1,
        signals=(Signal("u", Role.INPUT), Signal("q", Role.INPUT, (JOINT,))),
        parameters=(
            Parameter("gain", initial=(0.7,)),
            Parameter("mix", (BASIS, JOINT), initial=(0.4, -0.9, 0.2, 1.1, 0.3, -0.6)),
        ),
        states=(State("x", (JOINT,), None, Declared(), follower, first),),
        step=b.graph(),
        start=starts.graph(),
        outputs=tuple(Output(f"y{i}", value) for i, value in enumerate(results)),
    )


def _one_sample(pool: _Pool, value: NodeId) -> NodeId:
    """The value summed over all axes but the state's."""
    for axis in pool.b.type(value).axes:
        if axis != JOINT:
            value = pool.b.sum(value, axis.name)
    return value
