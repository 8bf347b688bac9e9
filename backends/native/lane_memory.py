"""Memory layout of a rollout: signals and buffers as arrays over time, not rings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.tree import Name
from backends.native.loop_splitting import LateAdjoint, Phases, late_adjoints, split_loops
from backends.ports.identifiers import c_identifier
from compiler.differentiation.training_step import TrainingStep
from compiler.ir.nodes import Extent, extents
from compiler.ir.ops import ReadLog, ReadSignal
from compiler.ir.program import NodeId, Program, State
from compiler.ir.types import WINDOW, Axis


def size_of(axes: tuple[Axis, ...]) -> int:
    """The number of elements of a value with these axes; 1 without axes."""
    size = 1
    for axis in axes:
        size *= axis.size
    return size


def _shape(axes: tuple[Axis, ...]) -> tuple[int, ...]:
    return tuple(axis.size for axis in axes)


@dataclass(frozen=True, slots=True)
class LaneTape:
    """A C array over time of one vector of rollouts, oldest first: each row has `elements` values.
    A function for time t gets a pointer to the row of sample t+`first`.
    """

    name: str
    elements: int
    first: int
    last: int
    """Offset from t of the last row that is used at t."""

    def place(self, shape: tuple[int, ...], first: int, count: int | None) -> ArrayView:
        """The place of samples from t+first on. With a `count`, that many samples lie along the
        last axis of `shape`; with None it is one sample of this shape.
        """
        # One row per time: t+k is at a fixed distance without modulo, and a window is a view that
        # overlaps that of the previous step.
        offset = Index((first - self.first) * self.elements)
        if count is None:
            return ArrayView(Name(self.name), shape, c_strides(shape), offset)
        inner = shape[:-1]
        return ArrayView(Name(self.name), shape, (*c_strides(inner), self.elements), offset)


@dataclass(frozen=True)
class LaneMemory:
    """The C arrays of one training kernel: names, elements per row, and which samples they hold."""

    step: TrainingStep

    @property
    def program(self) -> Program:
        return self.step.program

    @cached_property
    def signals(self) -> dict[str, LaneTape]:
        """The array of each signal that the step or the start reads, by name of signal."""
        found: dict[str, Extent] = {}
        for graph in (self.program.step, self.program.start):
            for log in (True, False):
                for name, extent in extents(graph, log=log).items():
                    # step and start get pointers to the same rows, which cover the reads of both
                    before = found.get(name)
                    found[name] = before.union(extent) if before else extent
        taken: set[str] = set()
        return {
            signal.name: LaneTape(
                c_identifier(f"log_{signal.name}", taken),
                size_of(signal.axes),
                found[signal.name].first,
                found[signal.name].last,
            )
            for signal in self.program.signals
            if signal.name in found
        }

    @cached_property
    def buffers(self) -> dict[str, LaneTape]:
        """The array of each buffer of n samples, by name of state: at time t its samples are in
        rows 0 … n−1, and the step writes the newest to row n.
        """
        taken: set[str] = set()
        return {
            state.name: LaneTape(
                c_identifier(f"tape_{state.name}", taken),
                size_of(state.axes[:-1]),
                0,
                # at t+1 the pointer starts one row later, so no sample is moved
                state.axes[-1].size,
            )
            for state in self.program.states
            if state.name in self.step.newest
        }

    def newest_row(self, state: State) -> ArrayView:
        """The place to which the step at t writes the newest sample of a buffer."""
        tape = self.buffers[state.name]
        return tape.place(_shape(state.axes[:-1]), tape.last, None)

    def adjoint_rows(self, state: State) -> ArrayView:
        """The place of the adjoints of all samples that a buffer holds at t, with the shape of the
        state.
        """
        tape = self.buffers[state.name]
        place = tape.place(_shape(state.axes), 0, state.axes[-1].size)
        # adjoints have the layout of their samples, in another array
        return ArrayView(Name(f"d_{tape.name}"), place.shape, place.strides, place.offset)

    @cached_property
    def plain(self) -> dict[str, tuple[str, State]]:
        """The C name and the state, by name, of the states that are not buffers."""
        taken: set[str] = set()
        return {
            state.name: (c_identifier(f"state_{state.name}", taken), state)
            for state in self.program.states
            if state.name not in self.step.newest
        }

    @cached_property
    def phases(self) -> Phases:
        return split_loops(self.step)

    @cached_property
    def rows(self) -> dict[NodeId, LaneTape]:
        """The arrays of nodes that the forward or reverse step stores at each time for later loops,
        by node id.
        """
        reverse = self.step.reverse_step.graph
        return {
            node: LaneTape(f"row_{node}", reverse[node].type.size, 0, 0)
            for node in self.phases.rows
        }

    @cached_property
    def late_adjoints(self) -> dict[LateAdjoint, LaneTape]:
        """For each late adjoint the array over time of its source. The reverse loop runs back in
        time, so the latest time is first. At t the step writes row n, where n is the length of the
        buffer.
        """
        reverse = self.step.reverse_step.graph
        return {
            adjoint: LaneTape(
                adjoint.name, reverse[adjoint.source].type.size, 0, self.buffers[adjoint.state].last
            )
            for adjoint in late_adjoints(self.step)
        }

    @cached_property
    def parameters(self) -> dict[str, int]:
        """The index of the first element of each parameter, by name, in the flat array of all
        parameters.
        """
        offsets: dict[str, int] = {}
        total = 0
        for parameter in self.program.parameters:
            offsets[parameter.name] = total
            total += size_of(parameter.axes)
        return offsets

    @property
    def parameter_count(self) -> int:
        return sum(size_of(parameter.axes) for parameter in self.program.parameters)


def read_of(tape: LaneTape, op: ReadSignal | ReadLog, axes: tuple[Axis, ...]) -> ArrayView:
    """The place of the samples that a read node with these axes means; the last axis may be the
    window.
    """
    shape = tuple(axis.size for axis in axes)
    windowed = bool(axes) and axes[-1].name == WINDOW
    return tape.place(shape, op.first, axes[-1].size if windowed else None)
