"""Writes the functions of a kernel, and the arguments that loops over time pass to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Argument, Binary, Expression, Function, Real
from backends.native.lane_functions import GRADIENT, PARAMETERS, LaneWriter, array
from backends.native.lane_memory import LaneMemory, size_of
from backends.native.loop_splitting import (
    Addends,
    LateGradient,
    is_zero,
    read_from_rows,
)
from backends.native.tiled_sums import HORIZON, MOMENT, TIME, TiledSum
from compiler.ir.ops import Concat, Contract
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Axis


@dataclass(frozen=True, slots=True)
class Passed:
    """An argument of a C function, and the C expression that the loop over time passes for it."""

    argument: Argument
    value: str


@dataclass(frozen=True, slots=True)
class ModelFunction:
    """A C function of the model, and the C expressions that its caller passes, one per argument."""

    function: Function
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Stored:
    """Values of the step that its C function also writes to an array: the name of the array (empty
    if there is none), and for each node its place in it.
    """

    array: str = ""
    places: tuple[tuple[NodeId, ArrayView], ...] = ()


class ModelFunctions:
    """Writes the C functions of a training kernel that depend on the model: start, step, their
    reverse, and sums before and after the loops over time. `functions` collects the helpers that
    they call; `stored` are additional results of the step.
    """

    def __init__(
        self, memory: LaneMemory, functions: FunctionTable, stored: Stored | None = None
    ) -> None:
        self._memory = memory
        self._functions = functions
        self._stored = stored or Stored()
        phases = memory.phases
        # three versions of the step; each reads more values from rows
        self._forward = read_from_rows(memory.program.step, phases.ahead)
        kept = (*phases.ahead, *phases.kept)
        self._reverse = read_from_rows(memory.step.reverse_step.graph, kept)
        self._after = read_from_rows(self._reverse, phases.cuts)

    def start(self) -> ModelFunction:
        """The C function that computes the states at t0."""
        program = self._memory.program
        writer = LaneWriter(self._memory, program.start, self._functions)
        lowered = writer.lowered(*(state.start for state in program.states))
        for state in program.states:
            lowered.store(state.start, writer.state_place(state))
        return self._made(writer, "kernel_start", self._common(""), "States at t0.")

    def ahead(self) -> ModelFunction:
        """The C function that runs before the loop over time: computes, for all times, sums of
        products of recorded samples, which do not depend on states.
        """
        writer = LaneWriter(self._memory, self._memory.program.step, self._functions)
        for node in self._memory.phases.ahead:
            self._write_ahead(writer, node)
        passed = [_horizon(), *self._common("")]
        return self._made(writer, "kernel_ahead", passed, "What waits for no state, at all times.")

    def _write_ahead(self, writer: LaneWriter, node: NodeId) -> None:
        made = writer.graph[node]
        assert isinstance(made.op, Contract)
        row = array(f"row_{node}", made.type.shape)
        sums = TiledSum(
            factors=tuple(writer.factors(made)),
            axes=made.type.axis_names,
            summed=(made.op.axis,),
            sizes=_sizes(writer.graph, made),
            over_time=False,
        )

        def store(indices: Mapping[str, Index], value: Expression, scope: BlockScope) -> None:
            position = row.position([indices[axis] for axis in made.type.axis_names])
            position = position.plus(indices[MOMENT].times(made.type.size))
            scope.assign(ArrayView(row.storage, (), (), position).element(()), value)

        sums.write(writer.scope, store)

    def step(self) -> ModelFunction:
        """The C function of one step forward: computes states at t+1 and terms of losses, and
        stores values that the reverse step needs.
        """
        memory, step = self._memory, self._memory.step
        writer = LaneWriter(memory, self._forward, self._functions)
        results = [
            (step.newest[state.name], memory.newest_row(state))
            if state.name in step.newest
            else (state.next, array(f"next_{memory.plain[state.name][0]}", writer.shape(state)))
            for state in step.program.states
        ]
        results += [
            (node, array(f"row_{node}", self._forward[node].type.shape))
            for node in memory.phases.kept
        ]
        # a sensitivity kernel also stores residuals and their derivatives
        results += self._stored.places
        terms = [(term.total, index, "total") for index, term in enumerate(step.losses)]
        terms += [
            (term.count, index, "count")
            for index, term in enumerate(step.losses)
            if term.count is not None
        ]
        lowered = writer.lowered(*(node for node, _ in results), *(node for node, _, _ in terms))
        for node, place in results:
            lowered.store(node, place)
        for node, index, name in terms:
            lowered.store(node, array(name, (), Index(index)))
        for index, term in enumerate(step.losses):
            # all elements are scored: a constant count
            if term.count is None:
                target = array("count", (), Index(index)).element(())
                writer.scope.assign(target, Real(float(term.elements)))
        passed = self._common(TIME)
        for name, state in memory.plain.values():
            # states are in rows over time, so the reverse step reads the same values
            next_row = f"{name} + (t + 1) * {size_of(state.axes)}"
            passed.append(Passed(Argument("lanes *", f"next_{name}"), next_row))
        arrays = (
            ("total", "count", self._stored.array) if self._stored.array else ("total", "count")
        )
        passed += [Passed(Argument("lanes *restrict", name), name) for name in arrays]
        return self._made(writer, "kernel_step", passed, "One step forward.")

    def reverse_step(self) -> ModelFunction:
        """The C function of one step backward: adjoints of states at t from those at t+1. It also
        adds terms to the gradients of parameters.
        """
        memory, phases = self._memory, self._memory.phases
        writer = LaneWriter(memory, self._reverse, self._functions)
        found = memory.step.reverse_step.gradients
        sums = Addends(self._reverse, (*found.states.values(), *found.parameters.values()))
        added: list[tuple[NodeId, ArrayView]] = []
        stored = [(n, array(f"row_{n}", writer.graph[n].type.shape)) for n in phases.cuts]
        for state in memory.program.states:
            gradient = found.states.get(state.name)
            if gradient is None:
                continue
            if state.name in memory.buffers:
                # late terms are added from their own tape, not here
                late = {one.addend for one in memory.late_adjoints if one.state == state.name}
                for addend in sums.of(gradient):
                    if addend not in late:
                        # adjoints of a buffer accumulate per sample over all windows
                        added += _parts(writer.graph, addend, memory.adjoint_rows(state))
            else:
                place = array(f"d_{memory.plain[state.name][0]}", writer.shape(state))
                stored.append((gradient, place))
        for adjoint, tape in memory.late_adjoints.items():
            writer.collect(adjoint)
            shape = writer.graph[adjoint.source].type.shape
            stored.append((adjoint.source, tape.place(shape, tape.last, None)))
        added += [(node, self._gradient_place(name)) for name, node in phases.direct]
        lowered = writer.lowered(*(node for node, _ in (*stored, *added)))
        for node, place in stored:
            lowered.store(node, place)
        for node, place in added:
            writer.add_to(lowered, node, place)
        scale = Passed(Argument("const lanes *restrict", "scale"), "scale")
        passed = [*self._adjoints(TIME, "(t + 1)"), scale]
        for tape in memory.late_adjoints.values():
            # reverse order of time: the latest step is first in the tape
            newest = f"{tape.name} + ({HORIZON} - 1 - t) * {tape.elements}"
            passed.append(Passed(Argument("lanes *restrict", tape.name), newest))
        return self._made(writer, "kernel_reverse_step", passed, "Adjoints at t from those at t+1.")

    def after(self) -> ModelFunction:
        """The C function that runs after the reverse loop: adds those gradients of parameters that
        are sums of products over time. A product that is stored in rows can be a factor of another;
        its own factors are stored too.
        """
        writer = LaneWriter(self._memory, self._after, self._functions)
        for late in self._memory.phases.late:
            self._write_late(writer, late)
        gradient = Passed(Argument("lanes *restrict", GRADIENT), GRADIENT)
        passed = [_horizon(), *self._common(""), gradient]
        return self._made(writer, "kernel_after", passed, "Gradients that are sums over the time.")

    def _write_late(self, writer: LaneWriter, late: LateGradient) -> None:
        made = self._reverse[late.product]
        target = self._gradient_place(late.parameter)
        summed = (made.op.axis,) if isinstance(made.op, Contract) else ()
        sums = TiledSum(
            factors=tuple(writer.factors(made)),
            axes=made.type.axis_names,
            summed=summed,
            sizes=_sizes(writer.graph, made),
            over_time=True,
        )

        def store(indices: Mapping[str, Index], value: Expression, scope: BlockScope) -> None:
            element = target.element([indices[axis] for axis in made.type.axis_names])
            scope.assign(element, Binary("+", element, value))

        sums.write(writer.scope, store)

    def reverse_start(self) -> ModelFunction:
        """The C function that adds the gradients of parameters on which the states at t0 depend."""
        reverse = self._memory.step.reverse_start
        writer = LaneWriter(self._memory, reverse.graph, self._functions)
        gradients = reverse.gradients.parameters
        lowered = writer.lowered(*gradients.values())
        for name, node in gradients.items():
            writer.add_to(lowered, node, self._gradient_place(name))
        passed = self._adjoints("", "")
        return self._made(writer, "kernel_reverse_start", passed, "What the states at t0 owe to.")

    # ---- arguments

    def _common(self, at: str) -> list[Passed]:
        """The arguments of all functions: parameters, logs, buffers, plain states and rows over
        time. `at` is the C variable of the time by which the pointers advance, empty at t0.
        """
        memory = self._memory

        def row(type: str, name: str, size: int) -> Passed:
            return Passed(Argument(type, name), f"{name} + {at} * {size}" if at else name)

        found = [Passed(Argument("const lanes *restrict", PARAMETERS), PARAMETERS)]
        found += [row("const lanes *", s.name, s.elements) for s in memory.signals.values()]
        # tapes and states are not `restrict`: rows of one array are read and written
        found += [row("lanes *", tape.name, tape.elements) for tape in memory.buffers.values()]
        found += [row("lanes *", name, size_of(s.axes)) for name, s in memory.plain.values()]
        found += [row("lanes *restrict", r.name, r.elements) for r in memory.rows.values()]
        return found

    def _adjoints(self, at: str, after: str) -> list[Passed]:
        """The arguments of reverse functions: all arguments of forward functions at the time `at`,
        the adjoints of buffers and plain states at `at`, and the gradient. Also the adjoints of
        plain states at `after`, the C expression of t+1. `at` and `after` are empty for the start,
        which has no earlier adjoints.
        """
        found = self._common(at)
        for tape in self._memory.buffers.values():
            name = f"d_{tape.name}"
            value = f"{name} + {at} * {tape.elements}" if at else name
            found.append(Passed(Argument("lanes *restrict", name), value))
        for name, state in self._memory.plain.values():
            size = size_of(state.axes)
            following = f"d_{name} + {after} * {size}" if after else f"d_{name}"
            found.append(Passed(Argument("lanes *restrict", f"d_next_{name}"), following))
            # the start has no earlier row of adjoints
            if after:
                row = f"d_{name} + {at} * {size}"
                found.append(Passed(Argument("lanes *restrict", f"d_{name}"), row))
        found.append(Passed(Argument("lanes *restrict", GRADIENT), GRADIENT))
        return found

    def _gradient_place(self, name: str) -> ArrayView:
        shape = tuple(axis.size for axis in self._memory.program.parameter(name).axes)
        return array(GRADIENT, shape, Index(self._memory.parameters[name]))

    @staticmethod
    def _made(writer: LaneWriter, name: str, passed: list[Passed], doc: str) -> ModelFunction:
        function = writer.function(name, [p.argument for p in passed], doc)
        return ModelFunction(function, tuple(p.value for p in passed))


def _horizon() -> Passed:
    return Passed(Argument("size_t", HORIZON), HORIZON)


def _sizes(graph: Graph, node: Node) -> dict[str, int]:
    """The sizes of all axes of a node's operands, by name of axis."""
    axes: list[Axis] = [axis for arg in node.args for axis in graph[arg].type.axes]
    return {axis.name: axis.size for axis in axes}


def _parts(graph: Graph, node: NodeId, target: ArrayView) -> list[tuple[NodeId, ArrayView]]:
    """Splits the addition of a node to the place `target` into (node, place) pairs: a concatenation
    is added part by part, and parts that are structural zeros are left out.
    """
    # gradients of slices are padded with zeros, which need not be added
    if is_zero(graph, node):
        return []
    op = graph[node].op
    if not isinstance(op, Concat):
        return [(node, target)]
    axis = graph[node].type.position(op.axis)
    found: list[tuple[NodeId, ArrayView]] = []
    begin = 0
    for part in graph[node].args:
        end = begin + graph[part].type.shape[axis]
        found += _parts(graph, part, target.sliced(axis, begin, end))
        begin = end
    return found
