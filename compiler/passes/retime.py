"""Moves functions of single samples from behind a delay line to before it: a window of f(x) instead
of f(window of x).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import assert_never

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.ops import ReadState, Slice, Window
from compiler.ir.program import Expected, Graph, History, Node, NodeId, Program, State
from compiler.ir.types import WINDOW, Axis
from compiler.passes.simplify import drop_unused
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampled:
    """The samples of a buffer's window on which a value depends: `count` samples from index `first`
    on; index 0 is the oldest.
    """

    buffer: str
    first: int
    count: int
    with_newest: bool
    """True if it reads the window with the newest sample, not only the buffer."""
    calls: bool = False
    """True if it calls a scalar function for each sample."""


@dataclass(frozen=True, slots=True)
class Samplewise:
    """The nodes of one graph that are functions of single samples of a buffer, with these
    samples.
    """

    sampled: dict[NodeId, Sampled]
    fixed: frozenset[NodeId]
    """Nodes that depend on constants only, or also on parameters if these count as fixed."""


def samplewise(graph: Graph, buffers: frozenset[str], *, parameters: bool) -> Samplewise:
    """Finds the nodes that apply one function f to each of several samples of one of the `buffers`:
    f(x[t]), f(x[t-1]), ….

    Other operands must be constants; with `parameters` they may also depend on parameters.
    """
    sampled: dict[NodeId, Sampled] = {}
    fixed: set[NodeId] = set()
    for index, node in graph:
        match node.op:
            case ops.Constant():
                fixed.add(index)
            case ops.ReadParameter():
                # while training changes a parameter, stored values f(x) would become outdated
                if parameters:
                    fixed.add(index)
            case ops.Window(name) | ops.ReadState(name):
                if name in buffers:
                    count = node.type.axes[-1].size
                    sampled[index] = Sampled(
                        buffer=name,
                        first=0,
                        count=count,
                        with_newest=isinstance(node.op, ops.Window),
                    )
            # the log is not a buffer that the step shifts
            case ops.ReadSamples():
                pass
            case _ if all(arg in fixed for arg in node.args):
                fixed.add(index)
            case _:
                found = _sampled(graph, node, sampled, fixed)
                if found is not None:
                    sampled[index] = found
    return Samplewise(sampled, frozenset(fixed))


def at_samples(
    builder: GraphBuilder,
    graph: Graph,
    node: NodeId,
    copies: dict[NodeId, NodeId],
    samples: NodeId,
    count: int | None,
    work: Samplewise,
) -> NodeId:
    """Applies the function that `node` computes from each sample of a buffer to `samples` instead;
    returns the new node.

    `samples` is a node of the builder: one sample (`count` is None), or a window of `count`. `work`
    describes `graph`. `copies` maps nodes of `graph` to the builder's; it gets those that are
    missing.
    """
    made: dict[NodeId, NodeId] = {}
    for index in _ancestors(graph, [node], work):
        found = graph[index]
        axes = tuple(axis for axis in found.type.axes if axis.name != WINDOW)
        if count is not None and found.type.window is not None:
            axes = (*axes, Axis(WINDOW, count))
        # a fixed value was broadcast to the old window: use it before the broadcast
        if index in work.fixed:
            repeated = found.type.window is not None
            fixed = _copied(builder, graph, found.args[0] if repeated else index, copies)
            made[index] = builder.broadcast(fixed, axes) if repeated else fixed
        elif isinstance(found.op, ops.Window | ops.ReadState):
            made[index] = samples
        elif isinstance(found.op, ops.Slice) and found.op.axis == WINDOW:
            # `Sampled` describes the slice; the function of one sample has none
            made[index] = made[found.args[0]]
        elif isinstance(found.op, ops.Broadcast):
            made[index] = builder.broadcast(made[found.args[0]], axes)
        else:
            with builder.at(found.span):
                args = tuple(made[arg] for arg in found.args)
                made[index] = builder.emit(found.op, args, found.type.with_axes(axes))
    return made[node]


def _ancestors(graph: Graph, wanted: list[NodeId], work: Samplewise) -> list[NodeId]:
    """The ids of the nodes on which the wanted ones depend, operands first. The search ends at
    nodes that are fixed by `work` and at the samples themselves, which are included.
    """
    found = set[NodeId]()
    while wanted:
        index = wanted.pop()
        if index not in found:
            found.add(index)
            # the search ends at fixed nodes and windows
            if index not in work.fixed and not isinstance(graph[index].op, ops.Window):
                wanted += graph[index].args
    return sorted(found)


def _copied(
    builder: GraphBuilder, graph: Graph, wanted: NodeId, copies: dict[NodeId, NodeId]
) -> NodeId:
    """The id of the node `wanted` of `graph` in the builder's graph; copies it with its operands
    unless `copies` has it.
    """
    missing, waiting = set[NodeId](), [wanted]
    while waiting:
        index = waiting.pop()
        if index not in copies and index not in missing:
            missing.add(index)
            waiting += graph[index].args
    for index in sorted(missing):
        found = graph[index]
        copies[index] = copy_node(builder, found, tuple(copies[arg] for arg in found.args))
    return copies[wanted]


def _sampled(
    graph: Graph, node: Node, sampled: dict[NodeId, Sampled], fixed: set[NodeId]
) -> Sampled | None:
    match node.op:
        case ops.Slice(axis, start, stop) if axis == WINDOW:
            source = sampled.get(node.args[0])
            if source is None:
                return None
            return replace(source, first=source.first + start, count=stop - start)
        case ops.Elementwise() | ops.Broadcast():
            return _of_operands(graph, node, sampled, fixed)
        case ops.Sum(axis) | ops.Contract(axis):
            # a sum over the window mixes samples; one over another axis does not
            return None if axis == WINDOW else _of_operands(graph, node, sampled, fixed)
        case ops.Leaf() | ops.Window() | ops.Structure():
            return None
        case _:
            assert_never(node.op)


def _of_operands(
    graph: Graph, node: Node, sampled: dict[NodeId, Sampled], fixed: set[NodeId]
) -> Sampled | None:
    """The samples on which all operands of the node depend, apart from `fixed` operands; `sampled`
    has those of earlier nodes. None if they differ, or if a fixed operand varies along the window.
    """
    found = [sampled[arg] for arg in node.args if arg in sampled]
    others = [arg for arg in node.args if arg not in sampled]
    # x[t-1] + x[t] depends on two samples: f(x) requires operands with the same samples
    spans = {replace(operand, calls=False) for operand in found}
    if len(spans) != 1 or not all(arg in fixed and _repeated(graph, arg) for arg in others):
        return None
    calls = isinstance(node.op, ops.Apply) or any(operand.calls for operand in found)
    return replace(found[0], calls=calls)


def _repeated(graph: Graph, index: NodeId) -> bool:
    """True if the value of the node is the same for every sample of a window."""
    node = graph[index]
    if node.type.window is None:
        return True
    # weights along a window differ per sample, so they cannot move before the buffer
    return isinstance(node.op, ops.Broadcast) and graph[node.args[0]].type.window is None


def retime(program: Program, *, fixed_parameters: bool) -> Program:
    """If a history of x is only read as f(window of x), keeps a history of f(x) instead.

    f is any function of single samples: elementwise, and sums over axes other than the window. It
    may read constants, and parameters if `fixed_parameters` says that these are fixed, since a
    changed parameter would invalidate stored samples. The new buffer starts as f of the start of
    the old one. f(x) is no larger than x; both buffers are kept only if f calls a scalar function
    (`tanh`).

    Before: step form, without losses. After: the same outputs up to rounding, in step form.
    Example, before and after:

        %1: [t=30] = window(x.history, %0)
        %2: [t=30] = tanh(%1)

        %1: scalar = tanh(%0)
        %2: [t=30] = window(tanh.history, %1)
    """
    # the reads of a buffer's window by nodes that are not samplewise determine the functions of x
    # that must be stored
    buffers = _buffers(program)
    work = samplewise(program.step, frozenset(buffers), parameters=fixed_parameters)
    moves = [
        move
        for name, uses in _uses(program, buffers, work).items()
        for move in _worthwhile(program, _candidates(program, buffers[name], uses, work))
    ]
    return _moved(program, moves, work) if moves else program


@dataclass(frozen=True, slots=True)
class _Buffer:
    """A buffer of past samples with exactly one `Window`, the node that appends the sample `newest`
    in each step; `kept` is the number of its samples.
    """

    state: State
    newest: NodeId
    """The sample that the step adds."""
    kept: int
    """Number of samples in the buffer."""


@dataclass(frozen=True, slots=True)
class _Move:
    """One function f that moves before the buffer: the nodes `uses` that are f of samples of it,
    and the name of the new buffer, which stores f(x).
    """

    buffer: _Buffer
    name: str
    uses: dict[NodeId, Sampled]
    calls: bool
    """True if f calls a scalar function."""

    @property
    def oldest(self) -> int:
        """Index of the oldest sample in the old window that is still needed."""
        return min(sampled.first for sampled in self.uses.values())


def _buffers(program: Program) -> dict[str, _Buffer]:
    windows: dict[str, list[NodeId]] = {}
    for index, node in program.step:
        if isinstance(node.op, Window):
            windows.setdefault(node.op.state, []).append(index)
    found: dict[str, _Buffer] = {}
    for state in program.states:
        following = program.step[state.next]
        kept = state.axes[-1].size if state.axes else 0
        # the buffer's own shift does not count as a use of its samples
        moved = following.op == Slice(WINDOW, 1, kept + 1)
        if isinstance(state.origin, History) and moved:
            (window,) = following.args
            # exactly one window: another one would read samples of f(x)
            if windows.get(state.name) == [window]:
                found[state.name] = _Buffer(state, program.step[window].args[0], kept)
    return found


def _uses(
    program: Program, buffers: dict[str, _Buffer], work: Samplewise
) -> dict[str, list[NodeId]]:
    """For each buffer, the samplewise nodes of `work` that outputs, states or nodes that are not
    samplewise read.
    """
    needed = {output.node for output in program.outputs}
    # the next value of a buffer is the shift, which the new buffer replaces
    needed |= {state.next for state in program.states if state.name not in buffers}
    for index, node in program.step:
        if index not in work.sampled:
            needed.update(node.args)
    found: dict[str, list[NodeId]] = {}
    for index, sampled in work.sampled.items():
        if index in needed:
            found.setdefault(sampled.buffer, []).append(index)
    return found


def _candidates(
    program: Program, buffer: _Buffer, uses: list[NodeId], work: Samplewise
) -> list[_Move]:
    """One move for each function f of single samples of the buffer that the nodes `uses` compute;
    f(x) = x may be among them.
    """
    graph = program.step
    scratch = GraphBuilder(graph)
    same = {index: index for index in range(len(graph))}
    groups: dict[NodeId, dict[NodeId, Sampled]] = {}
    for index in uses:
        # writes each value as a function of one sample: equal functions become one node
        group = at_samples(scratch, graph, index, same, buffer.newest, None, work)
        groups.setdefault(group, {})[index] = work.sampled[index]
    moves: list[_Move] = []
    for group, members in groups.items():
        calls = any(sampled.calls for sampled in members.values())
        # f(x) = x: the samples themselves are needed, the old buffer stays
        plain = group == buffer.newest
        name = buffer.state.name if plain else _name(program, buffer, members, moves)
        moves.append(_Move(buffer, name, members, calls))
    return moves


def _name(
    program: Program, buffer: _Buffer, uses: dict[NodeId, Sampled], others: list[_Move]
) -> str:
    """A free name for the new buffer: after the label of a value in `uses`, otherwise after the
    source of the old buffer.
    """
    taken = {state.name for state in program.states} | {move.name for move in others}
    labels = [label for index in uses if (label := program.step[index].label)]
    assert isinstance(buffer.state.origin, History)
    base = labels[0] if labels else f"{buffer.state.origin.source}.mapped"
    name, number = f"{base}.history", 1
    while name in taken:
        number += 1
        name = f"{base}.history{number}"
    return name


def _worthwhile(program: Program, moves: list[_Move]) -> list[_Move]:
    """The moves that are carried out: those with a gain (`_fits`), and if a buffer has several
    moves only those that save calls of scalar functions.
    """
    fit = [move for move in moves if _fits(program, move)]
    # several functions of one buffer need several buffers, which pays off for calls only
    if len(moves) > 1:
        return [move for move in fit if move.calls]
    return fit


def _fits(program: Program, move: _Move) -> bool:
    samples = program.step[move.buffer.newest].type
    # the samples themselves are needed: nothing moves
    if move.name == move.buffer.state.name:
        return False
    types = [program.step[index].type for index in move.uses]
    # for f of a single delayed sample there is no gain
    one_sample = all(type.window == 1 for type in types)
    return not one_sample and all(
        type.kind == "real" and type.window and type.size // type.window <= samples.size
        for type in types
    )


def _moved(program: Program, moves: list[_Move], work: Samplewise) -> Program:
    """The program after all moves; `work` describes its step."""
    builder, starts = GraphBuilder(), GraphBuilder(program.start)
    by_use = {index: move for move in moves for index in move.uses}
    copies: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        move = by_use.get(index)
        if move is None:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
        else:
            with builder.at(node.span):
                copies[index] = _window_of(builder, program.step, index, copies, move, work)
    states = [_state(program, move, builder, starts, copies, work) for move in moves]
    # the range of an equation is checked when its value is computed
    expected = tuple(dict.fromkeys(_expected(program, moves, builder, copies, work)))
    program = with_step(program, builder.graph(), copies)
    program = replace(
        program,
        states=(*program.states, *states),
        start=starts.graph(),
        expected=expected,
    )
    return drop_unused(program)


def _expected(
    program: Program,
    moves: list[_Move],
    builder: GraphBuilder,
    copies: dict[NodeId, NodeId],
    work: Samplewise,
) -> Iterator[Expected]:
    """The expected ranges with new node ids, by `copies`. That of a window moves to its newest
    sample, so that each sample is checked once.
    """
    newest = {move.buffer.state.name: copies[move.buffer.newest] for move in moves}
    uses = {index for move in moves for index in move.uses}
    for entry in program.expected:
        sampled = work.sampled.get(entry.node)
        if sampled is not None and sampled.buffer in newest:
            sample = newest[sampled.buffer]
            node = at_samples(builder, program.step, entry.node, copies, sample, None, work)
            yield replace(entry, node=node)
        if entry.node not in uses:
            yield replace(entry, node=copies[entry.node])


def _window_of(
    builder: GraphBuilder,
    graph: Graph,
    index: NodeId,
    copies: dict[NodeId, NodeId],
    move: _Move,
    work: Samplewise,
) -> NodeId:
    """The node of the samples of f(x), from the new buffer of `move`, that replaces the node
    `index`. `copies` maps old node ids to those of the builder.
    """
    sampled, like = move.uses[index], graph[index].type
    # older samples are not needed
    length = move.buffer.kept - move.oldest
    axes = like.axes[:-1]
    if sampled.with_newest:
        newest = at_samples(builder, graph, index, copies, copies[move.buffer.newest], None, work)
        type = builder.type(newest).with_axes((*axes, Axis(WINDOW, length + 1)))
        whole = builder.emit(Window(move.name), (newest,), type)
    else:
        type = like.with_axes((*axes, Axis(WINDOW, length)))
        whole = builder.emit(ReadState(move.name), (), type)
    first = sampled.first - move.oldest
    return builder.slice(whole, WINDOW, first, first + sampled.count)


def _state(
    program: Program,
    move: _Move,
    builder: GraphBuilder,
    starts: GraphBuilder,
    copies: dict[NodeId, NodeId],
    work: Samplewise,
) -> State:
    """The new buffer of f(x) for `move`, as a state; its initial samples are f of those of the old
    buffer. `builder` is that of the step, `starts` that of the start; `copies` maps old node ids of
    the step to new ones.
    """
    buffer, use = move.buffer, next(iter(move.uses))
    graph, old = program.step, buffer.state
    length = buffer.kept - move.oldest
    newest = at_samples(builder, graph, use, copies, copies[buffer.newest], None, work)
    window = builder.window(move.name, newest, length)
    following = builder.slice(window, WINDOW, 1, length + 1)
    # the start is evaluated once, before the first step
    past = starts.slice(old.start, WINDOW, move.oldest, buffer.kept)
    start = at_samples(starts, graph, use, {}, past, length, work)
    assert isinstance(old.origin, History)
    source = graph[use].label or old.origin.source
    return State(
        name=move.name,
        axes=builder.type(following).axes,
        unit=builder.type(following).unit,
        origin=History(source),
        next=following,
        start=start,
        doc=old.doc,
        span=graph[use].span or old.span,
    )
