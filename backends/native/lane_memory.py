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
    """Number of scalars of a value with these axes."""
    size = 1
    for axis in axes:
        size *= axis.size
    return size


def _shape(axes: tuple[Axis, ...]) -> tuple[int, ...]:
    return tuple(axis.size for axis in axes)


@dataclass(frozen=True, slots=True)
class LaneTape:
    """A C array with one row of `elements` values per time, oldest first, for one group of
    rollouts.

    A function for time t gets a pointer to the row of sample t+`first`.
    """

    name: str
    elements: int
    first: int
    last: int
    """Offset from t of the last row that is used at t."""

    def place(self, shape: tuple[int, ...], first: int, count: int | None) -> ArrayView:
        """A view of samples from t+first on: `count` of them along the last axis of `shape`, None
        for one sample.
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
    """The layout of all C arrays of one training kernel."""

    step: TrainingStep

    @property
    def program(self) -> Program:
        return self.step.program

    @cached_property
    def signals(self) -> dict[str, LaneTape]:
        """The log of each signal that the step or the start reads."""
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
        """The samples of each buffer: at t rows 0 … n−1, the newest sample becomes row n."""
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
        """The row for the newest sample of a buffer at t."""
        tape = self.buffers[state.name]
        return tape.place(_shape(state.axes[:-1]), tape.last, None)

    def adjoint_rows(self, state: State) -> ArrayView:
        """The adjoints of the samples in a buffer at t."""
        tape = self.buffers[state.name]
        place = tape.place(_shape(state.axes), 0, state.axes[-1].size)
        # adjoints have the layout of their samples, in another array
        return ArrayView(Name(f"d_{tape.name}"), place.shape, place.strides, place.offset)

    @cached_property
    def plain(self) -> dict[str, tuple[str, State]]:
        """The C name of each state that is not a buffer."""
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
        """The arrays over time of nodes that the forward or reverse step stores for later loops."""
        reverse = self.step.reverse_step.graph
        return {
            node: LaneTape(f"row_{node}", reverse[node].type.size, 0, 0)
            for node in self.phases.rows
        }

    @cached_property
    def late_adjoints(self) -> dict[LateAdjoint, LaneTape]:
        """The arrays of the sources of late adjoints, latest time first; at t the newest becomes
        row n.
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
        """Index of the first element of each parameter among all parameters."""
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
    """The samples of a signal that a node reads."""
    shape = tuple(axis.size for axis in axes)
    windowed = bool(axes) and axes[-1].name == WINDOW
    return tape.place(shape, op.first, axes[-1].size if windowed else None)
