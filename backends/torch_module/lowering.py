"""Lowers a graph of the IR to a `torch.fx` graph: straight-line tensor code, batch first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import torch
from torch import Tensor, fx, nn

from compiler.ir import ops
from compiler.ir.ops import Relation
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Axis, Type
from compiler.passes.expand_functions import expand_functions
from compiler.passes.guard_derivatives import guard_infinite_slopes, guard_untaken


@dataclass(frozen=True, slots=True)
class GivenNode:
    """A node whose value the lowered code does not compute but gets as an argument."""

    node: NodeId


@dataclass(frozen=True, slots=True)
class TorchLeaf:
    """One argument of lowered code: what it is a value of (a read or a given node), and True if the
    value has a window axis.
    """

    source: ops.AnyRead | GivenNode
    windowed: bool


@dataclass(frozen=True, slots=True)
class LoweredGraph:
    """Torch code of a graph. It is called with one tensor for each element of `leaves`, and returns
    one for each root.
    """

    module: fx.GraphModule
    leaves: tuple[TorchLeaf, ...]
    origins: dict[str, Node]
    """The IR node of each name in the generated code, for comments."""

    def __call__(self, arguments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        return self.module(*arguments)


def static_nodes(graph: Graph) -> list[bool]:
    """For each node, True if it depends on parameters and constants only. The tensors of such nodes
    have no batch axis.
    """
    static: list[bool] = []
    for _, node in graph:
        match node.op:
            case ops.Constant() | ops.ReadParameter():
                static.append(True)
            case ops.ReadSamples() | ops.ReadState() | ops.Window():
                static.append(False)
            case _:
                static.append(all(static[arg] for arg in node.args))
    return static


def prepared(program: Program) -> Program:
    """The program as it is lowered to torch: functions that torch lacks are expanded, and
    operations are guarded so that autograd gives no NaN where a derivative is not used.
    """
    # guarded before lowering, since autograd evaluates 0 · ∞ as NaN
    return guard_infinite_slopes(guard_untaken(expand_functions(program, NATIVE_FUNCTIONS)))


def lower_graph(
    graph: Graph,
    roots: Sequence[NodeId],
    dtype: torch.dtype,
    *,
    given: frozenset[NodeId] = frozenset(),
    identify: Callable[[TorchLeaf], str] | None = None,
    constants: str = "constant",
) -> LoweredGraph:
    """Torch code for the values of `roots`; nodes in `given` become arguments of the code.

    A value of shape (*shape) is a tensor (B, *shape), or (*shape) if the node is static
    (`static_nodes`). `identify` gives the name of an argument, to which a number is added.
    Constants are buffers of the module named `<constants>_0`, …. Derivatives of untaken branches
    must be guarded before (`guard_untaken`).
    """
    lowering = _Lowering(graph, dtype, given, identify or _default_name, constants)
    return lowering.run(roots)


def _default_name(leaf: TorchLeaf) -> str:
    return type(leaf.source).__name__.lower()


class _Lowering:
    def __init__(
        self,
        graph: Graph,
        dtype: torch.dtype,
        given: frozenset[NodeId],
        identify: Callable[[TorchLeaf], str],
        constants: str,
    ) -> None:
        self._graph = graph
        self._dtype = dtype
        self._given = given
        self._identify = identify
        self._static = static_nodes(graph)
        self._code = fx.Graph()
        self._root = nn.Module()
        self._leaves: dict[TorchLeaf, fx.Node] = {}
        self._values: dict[NodeId, fx.Node] = {}
        self._constants = constants
        self._constant_count = 0

    def run(self, roots: Sequence[NodeId]) -> LoweredGraph:
        needed = self._needed(roots)
        for index in needed:  # arguments come first in an fx graph
            leaf = self._leaf(index)
            if leaf is not None:
                self._values[index] = self._argument(leaf)
        for index in needed:
            if index not in self._values:
                self._values[index] = self._lower(index)
        self._code.output(tuple(self._values[root] for root in roots))
        # backwards, so that the first of several nodes with one value names it
        origins = {self._values[index].name: self._graph[index] for index in reversed(needed)}
        return LoweredGraph(fx.GraphModule(self._root, self._code), tuple(self._leaves), origins)

    def _needed(self, roots: Sequence[NodeId]) -> list[NodeId]:
        found = set(roots)
        pending = list(found)
        while pending:
            index = pending.pop()
            if index not in self._given:
                new = set(self._graph[index].args) - found
                found |= new
                pending.extend(new)
        return sorted(found)

    def _leaf(self, index: NodeId) -> TorchLeaf | None:
        node = self._graph[index]
        if index in self._given:
            return TorchLeaf(GivenNode(index), False)
        match node.op:
            case ops.ReadParameter() | ops.ReadState():
                return TorchLeaf(node.op, False)
            case ops.ReadSamples():
                return TorchLeaf(node.op, node.type.window is not None)
            case ops.Window(state):
                # a window is a concatenation: only the buffer's samples are an argument
                self._argument(TorchLeaf(ops.ReadState(state), False))
                return None
            case _:
                return None

    def _argument(self, leaf: TorchLeaf) -> fx.Node:
        if leaf not in self._leaves:
            name = f"{self._identify(leaf)}_{len(self._leaves)}".lower()  # as fx does
            self._leaves[leaf] = self._code.placeholder(name)
        return self._leaves[leaf]

    def _call(self, function: Callable[..., Any], *arguments: Any) -> fx.Node:
        return self._code.call_function(function, arguments)

    def _constant(self, values: tuple[float, ...], shape: tuple[int, ...]) -> fx.Node:
        name = f"{self._constants}_{self._constant_count}"
        self._constant_count += 1
        tensor = torch.tensor(values, dtype=self._dtype).reshape(shape)
        # a buffer moves with the module to other devices; files of weights omit it
        self._root.register_buffer(name, tensor, persistent=False)
        return self._code.get_attr(name)

    def _lower(self, index: NodeId) -> fx.Node:
        node = self._graph[index]
        args = [self._values[arg] for arg in node.args]
        types = [self._graph[arg].type for arg in node.args]
        static = [self._static[arg] for arg in node.args]
        match node.op:
            case ops.Read():
                raise AssertionError("leaves became arguments before")
            case ops.Constant(values):
                return self._constant(values, node.type.shape)
            case ops.Add():
                return self._call(torch.add, *args)
            case ops.Subtract():
                return self._call(torch.sub, *args)
            case ops.Multiply():
                return self._call(torch.mul, *args)
            case ops.Divide():
                return self._call(torch.div, *args)
            case ops.Negate():
                return self._call(torch.neg, *args)
            case ops.Identity():
                return args[0]
            case ops.Minimum():
                return self._extremum(torch.lt, args[0], node.args[1])
            case ops.Maximum():
                return self._extremum(torch.gt, args[0], node.args[1])
            case ops.Clamp():
                # torch.clamp has half the derivative, or 0, on the bound
                raised = self._extremum(torch.gt, args[0], node.args[1])
                return self._extremum(torch.lt, raised, node.args[2])
            case ops.Compare(relation):
                return self._call(RELATIONS[relation], *args)
            case ops.Select():
                return self._call(torch.where, *args)
            case ops.Apply(function):
                return scalar_function(self._code, function, args)
            case ops.Broadcast():
                return broadcast(self._code, args[0], types[0].axes, node.type.axes, static[0])
            case ops.Reshape():
                # the batch stays the first axis
                shape = node.type.shape if static[0] else (-1, *node.type.shape)
                return self._call(torch.reshape, args[0], shape)
            case ops.Slice(axis, start, stop):
                # counted from the end, which is independent of a batch axis
                dim = node.type.position(axis) - len(node.type.axes)
                return self._call(torch.narrow, args[0], dim, start, stop - start)
            case ops.Concat(axis):
                dim = node.type.position(axis) - len(node.type.axes)
                return concat(self._code, args, types, static, dim)
            case ops.Sum(axis):
                return sum_axis(self._code, args[0], types[0], axis)
            case ops.Contract(axis):
                return contract(self._code, args, types, static, axis, node.type)
            case ops.Window(state):
                buffer = self._leaves[TorchLeaf(ops.ReadState(state), False)]
                newest = args[0]
                if static[0]:
                    # torch.cat does not broadcast a value without a batch axis
                    newest = expand_static(self._code, newest, types[0], buffer)
                newest = self._call(torch.unsqueeze, newest, -1)
                return self._call(torch.cat, [buffer, newest], -1)
            case _:
                assert_never(node.op)

    def _extremum(self, wins: Callable[..., Any], first: fx.Node, other: NodeId) -> fx.Node:
        # torch.minimum splits the gradient of a tie between both operands; here the first gets it.
        # The second is selected where it wins or is NaN; a NaN in the first stays.
        second = self._values[other]
        second_wins = self._call(wins, second, first)
        if not self._is_number(other):
            second_wins = self._call(torch.logical_or, second_wins, self._call(torch.isnan, second))
        return self._call(torch.where, second_wins, second, first)

    def _is_number(self, index: NodeId) -> bool:
        """True if the value is a constant without NaN, or a broadcast or reshape of one."""
        node = self._graph[index]
        while isinstance(node.op, ops.Broadcast | ops.Reshape):
            node = self._graph[node.args[0]]
        return isinstance(node.op, ops.Constant) and not any(map(math.isnan, node.op.values))


RELATIONS: dict[Relation, Callable[..., Any]] = {
    Relation.LESS: torch.lt,
    Relation.LESS_EQUAL: torch.le,
    Relation.GREATER: torch.gt,
    Relation.GREATER_EQUAL: torch.ge,
}

NATIVE_FUNCTIONS: frozenset[str] = frozenset(
    {name for name, row in SCALAR_FUNCTIONS.items() if row.torch} | {"softplus"}
)
"""Scalar functions that torch has; others are first expanded by their definition."""


def scalar_function(code: fx.Graph, name: str, args: Sequence[fx.Node]) -> fx.Node:
    """Adds the call of a scalar function of the language, element by element, to the fx graph
    `code`; returns its node. Raises KeyError or AttributeError for a function that torch lacks.
    """
    if name == "softplus":  # log(exp(x) + exp(0)): exact tails, and derivative 1/2 at 0
        zero = code.call_function(torch.zeros_like, (args[0],))
        return code.call_function(torch.logaddexp, (args[0], zero))
    value = code.call_function(getattr(torch, SCALAR_FUNCTIONS[name].torch), tuple(args))
    if name == "sign":  # torch gives 0 for NaN
        missing = code.call_function(torch.isnan, (args[0],))
        return code.call_function(torch.where, (missing, args[0], value))
    return value


def broadcast(
    code: fx.Graph, value: fx.Node, old: tuple[Axis, ...], new: tuple[Axis, ...], static: bool
) -> fx.Node:
    """Adds the operations of a broadcast to the fx graph `code`: `value` with axes `old`, permuted
    to the order of the axes `new` and repeated along those that it lacks. `static`: without batch
    axis.
    """
    batch = 0 if static else 1
    names = [axis.name for axis in old]
    kept = [axis.name for axis in new if axis.name in names]
    if kept != names:
        order = [names.index(name) + batch for name in kept]
        # the batch stays first
        value = code.call_function(torch.permute, (value, (*range(batch), *order)))
    for position, axis in enumerate(new):
        if axis.name not in names:
            value = code.call_function(torch.unsqueeze, (value, position + batch))
    return _expanded(code, value, tuple(axis.size for axis in new), batch)


def _expanded(code: fx.Graph, value: fx.Node, shape: tuple[int, ...], batch: int) -> fx.Node:
    return code.call_method("expand", (value, *((-1,) * batch), *shape))


def expand_static(code: fx.Graph, value: fx.Node, type: Type, batched: fx.Node) -> fx.Node:
    """Adds the repetition of a tensor of this type without batch axis, to the batch size of the
    tensor `batched`, to the fx graph `code`.
    """
    batch = code.call_method("size", (batched, 0))
    return code.call_method("expand", (value, batch, *type.shape))


def concat(
    code: fx.Graph,
    args: Sequence[fx.Node],
    types: Sequence[Type],
    static: Sequence[bool],
    dim: int,
) -> fx.Node:
    """Adds the concatenation of the operands along `dim` (negative, counted from the last axis) to
    the fx graph `code`. `static` marks operands without batch axis; they are repeated if others
    have one.
    """
    # torch.cat does not broadcast: repeat static operands along the batch
    batched = next((arg for arg, fixed in zip(args, static, strict=True) if not fixed), None)
    if batched is not None:
        args = [
            expand_static(code, arg, type, batched) if fixed else arg
            for arg, type, fixed in zip(args, types, static, strict=True)
        ]
    return code.call_function(torch.cat, (list(args), dim))


def sum_axis(code: fx.Graph, value: fx.Node, type: Type, axis: str) -> fx.Node:
    """Adds the sum over the axis with this name to the fx graph `code`. `type` is that of `value`;
    a batch axis may come before its axes.
    """
    return code.call_function(torch.sum, (value, type.position(axis) - len(type.axes)))


def contract(
    code: fx.Graph,
    args: Sequence[fx.Node],
    types: Sequence[Type],
    static: Sequence[bool],
    axis: str,
    result: Type,
) -> fx.Node:
    """Adds Σ over one axis of the product of two operands to the fx graph `code`, by the cheapest
    torch call. `types` are those of the operands, `static` marks those without batch axis, `result`
    is the type of the sum.
    """
    left, right = types
    flat = [len(type.axes) == 1 for type in types]
    # a static vector on one side: a matrix product, for any axes of the other operand
    if flat[1] and static[1] and left.position(axis) == len(left.axes) - 1:
        return code.call_function(torch.matmul, (args[0], args[1]))
    if flat[0] and static[0] and right.position(axis) == len(right.axes) - 1:
        return code.call_function(torch.matmul, (args[1], args[0]))
    if flat == [True, True]:
        return code.call_function(
            torch.sum, (code.call_function(torch.mul, (args[0], args[1])), -1)
        )
    return code.call_function(torch.einsum, (_formula(types, static, result), *args))


def _formula(types: Sequence[Type], static: Sequence[bool], result: Type) -> str:
    """The formula of `torch.einsum` for a contraction: a letter for each axis name, and `z` for the
    batch, which static operands lack.
    """
    letters: dict[str, str] = {}
    for type in types:
        for axis in type.axes:
            # einsum names axes by letters; `z` is the batch
            letters.setdefault(axis.name, "abcdefghijklmnopqrstuvwxy"[len(letters)])
    terms = [
        ("" if fixed else "z") + "".join(letters[axis.name] for axis in type.axes)
        for type, fixed in zip(types, static, strict=True)
    ]
    batch = "" if all(static) else "z"
    return f"{','.join(terms)}->{batch}{''.join(letters[axis.name] for axis in result.axes)}"
