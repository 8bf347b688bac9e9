"""Memory of states in the struct: plain values, delay lines, shifted buffers, rings."""

from __future__ import annotations

import math
from dataclasses import dataclass

from backends.c_language import tree as c
from backends.c_language.places import ArrayView, Index, c_strides, variable
from backends.c_language.scope import BlockScope
from backends.c_lowering.options import Ring
from backends.c_lowering.values import copy_value
from compiler.ir.nodes import needed
from compiler.ir.ops import Slice, Window
from compiler.ir.program import History, NodeId, Program, State, Tape
from compiler.ir.types import WINDOW
from compiler.passes.analyses.saturation import unsaturated

_LONGEST_SHIFT = 32
"""Maximum number of samples for which shifting is cheap compared with reading (Cortex-M4F)."""


@dataclass(frozen=True, slots=True)
class PlainState:
    """A state that is no buffer, stored as one field of the state struct. Its next value is written
    at the end of the step.
    """

    state: State
    identifier: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int | None:
        """The length of the array in the struct; None for a scalar field."""
        return math.prod(self.shape) if self.shape else None

    @property
    def samples(self) -> ArrayView:
        """The place of the current value in the state struct."""
        return member_place("s", self.identifier, self.shape)

    def write(self, value: ArrayView, scope: BlockScope, unroll: int) -> None:
        copy_value(value, self.samples, scope, unroll)

    def write_start(self, start: ArrayView, scope: BlockScope, unroll: int) -> None:
        self.write(start, scope, unroll)


@dataclass(frozen=True, slots=True)
class DelayLine:
    """A buffer as an array of its samples, oldest first. At the end of a step its samples are
    shifted by one and the newest is appended. It has no place for the window with the newest
    sample.
    """

    state: State
    identifier: str
    shape: tuple[int, ...]
    """Axes of the signal, then the stored samples."""
    newest: NodeId
    """Node of the step with the newest sample."""

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def samples(self) -> ArrayView:
        return ArrayView.array(c.Member("s", self.identifier), self.shape)

    @property
    def last_sample(self) -> ArrayView:
        """The place of the sample that was appended last."""
        return _last(self.samples, self.shape[:-1])

    def write(self, newest: ArrayView, scope: BlockScope, unroll: int) -> None:
        axis, kept = len(self.shape) - 1, self.shape[-1]
        # copied in ascending order: each sample is read before it is overwritten
        rest = self.samples.sliced(axis, 0, kept - 1)
        copy_value(self.samples.sliced(axis, 1, kept), rest, scope, unroll)
        copy_value(newest, _last(self.samples, newest.shape), scope, unroll)

    def write_start(self, start: ArrayView, scope: BlockScope, unroll: int) -> None:
        copy_value(start, self.samples, scope, unroll)


@dataclass(frozen=True, slots=True)
class ShiftBuffer:
    """A buffer as an array of its samples, oldest first, with room for the newest one after them.
    The array is shifted by one at the end of the step.
    """

    state: State
    identifier: str
    shape: tuple[int, ...]
    """Axes of the signal, then the stored samples."""
    in_sum: bool = False
    """True if a sum shifts the samples while reading them; there is then no room for the newest
    sample."""

    @property
    def size(self) -> int:
        return math.prod(self.shape if self.in_sum else self.window.shape)

    @property
    def window(self) -> ArrayView:
        """The place of all samples including the newest one, which is the last."""
        *rows, kept = self.shape
        return ArrayView.array(c.Member("s", self.identifier), (*rows, kept + 1))

    @property
    def samples(self) -> ArrayView:
        return self.window.sliced(len(self.shape) - 1, 0, self.shape[-1])

    @property
    def last_sample(self) -> ArrayView:
        """The place of the sample that was appended last, as it is after the shift."""
        return _last(self.samples, self.shape[:-1])

    def write_start(self, start: ArrayView, scope: BlockScope, unroll: int) -> None:
        copy_value(start, self.samples, scope, unroll)

    def begin(self, scope: BlockScope) -> None:
        """Writes nothing: the samples have a fixed place. (`DoubledRing` reads its head here.)"""

    def push(self, newest: ArrayView, scope: BlockScope, unroll: int) -> None:
        if not self.in_sum:
            copy_value(newest, _last(self.window, newest.shape), scope, unroll)

    def fill(self, newest: ArrayView, scope: BlockScope, unroll: int) -> None:
        """Writes statements that set every stored sample to the newest one."""
        copy_value(_along_time(newest, self.shape), self.samples, scope, unroll)

    def commit(self, scope: BlockScope, unroll: int) -> None:
        axis = len(self.shape) - 1
        copy_value(self.window.sliced(axis, 1, self.shape[-1] + 1), self.samples, scope, unroll)


@dataclass(frozen=True, slots=True)
class DoubledRing:
    """A buffer as a ring that stores every sample twice, at `head` and at `head + length`. So the
    window of the last `length` samples is always contiguous, and no sample is moved.
    """

    state: State
    identifier: str
    shape: tuple[int, ...]
    head: str
    """The position in the ring: a field of the struct, and the local that a step reads it into.
    The field can reach `length`, which the next step wraps to 0."""

    @property
    def length(self) -> int:
        return self.shape[-1] + 1

    @property
    def size(self) -> int:
        return math.prod(self._storage.shape)

    @property
    def _storage(self) -> ArrayView:
        return ArrayView.array(c.Member("s", self.identifier), (*self.shape[:-1], 2 * self.length))

    def _from(self, offset: Index, count: int) -> ArrayView:
        strides = c_strides((*self.shape[:-1], 2 * self.length))
        return ArrayView(c.Member("s", self.identifier), (*self.shape[:-1], count), strides, offset)

    @property
    def window(self) -> ArrayView:
        # this step writes at the head; the next position has the oldest of `length` samples
        return self._from(variable(self.head).plus(Index(1)), self.length)

    @property
    def samples(self) -> ArrayView:
        # the same place without the newest sample
        return self._from(variable(self.head).plus(Index(1)), self.shape[-1])

    @property
    def last_sample(self) -> ArrayView:
        """The place of the sample that was appended last, within the step that appended it."""
        return _last(self.window, self.shape[:-1])

    def write_start(self, start: ArrayView, scope: BlockScope, unroll: int) -> None:
        scope.add(c.Assign(c.Member("s", self.head), c.Unsigned(0)))
        for offset in (1, 1 + self.length):
            copy_value(start, self._from(Index(offset), self.shape[-1]), scope, unroll)
        # the step writes both places of the newest sample before they are read
        zero = ArrayView.single(c.Real(0.0)).reshaped_single(self.shape[:-1])
        for offset in (0, self.length):
            copy_value(zero, _last(self._from(Index(offset), 1), zero.shape), scope, unroll)

    def begin(self, scope: BlockScope) -> None:
        """Writes the declaration of a local variable with the head (write position). A head that is
        too large, at the end of the ring or after a memory fault, becomes 0.
        """
        stored = c.Member("s", self.head)
        inside = c.Binary("<", stored, c.Unsigned(self.length))
        # a comparison instead of modulo: Cortex-M0 has no division; a corrupted head becomes 0
        head = c.Conditional(inside, stored, c.Unsigned(0))
        scope.reserve(self.head)
        scope.add(c.Declare(c.CType.UNSIGNED, self.head, head, constant=True))

    def push(self, newest: ArrayView, scope: BlockScope, unroll: int) -> None:
        for offset in (0, self.length):
            position = variable(self.head).plus(Index(offset))
            copy_value(newest, _last(self._from(position, 1), newest.shape), scope, unroll)

    def fill(self, newest: ArrayView, scope: BlockScope, unroll: int) -> None:
        copy_value(_along_time(newest, self._storage.shape), self._storage, scope, unroll)

    def commit(self, scope: BlockScope, unroll: int) -> None:
        # the stored value can be `length`, which `begin` wraps to 0
        scope.assign(c.Member("s", self.head), c.Binary("+", c.Name(self.head), c.Unsigned(1)))


Buffer = ShiftBuffer | DoubledRing
"""Memory that receives its newest sample during the step, and moves after it."""

StateMemory = PlainState | DelayLine | Buffer


def joining(memory: StateMemory) -> NodeId:
    """The node whose value is written to the memory of a state at the end of a step: the newest
    sample for a delay line, the next value for all others.
    """
    return memory.newest if isinstance(memory, DelayLine) else memory.state.next


def seen_values(program: Program) -> list[NodeId]:
    """The nodes of the step whose values are visible outside: outputs, equations with a range, and
    next values of saturated states before their limit, which are checked for NaN.
    """
    shown = [shown.node for shown in (*program.outputs, *program.expected)]
    return shown + list(unsaturated(program).values())


@dataclass(frozen=True, slots=True)
class InPlace:
    """A buffer whose samples C can shift in place. `newest` is the node of the newest sample."""

    newest: NodeId
    window_read: bool
    """True if anything except the buffer itself reads its window with the newest sample."""


def kept_in_place(program: Program) -> dict[str, InPlace]:
    """The buffers, by name of state, that C can shift in place: their next value is their only
    window without its oldest sample.
    """
    roots = seen_values(program) + [s.next for s in program.states]
    live = needed(program.step, roots)
    windows: dict[str, list[NodeId]] = {}
    users: dict[NodeId, set[NodeId]] = {}
    for index, node in program.step:
        # unused windows do not count; passes may leave them in the graph
        if live[index]:
            if isinstance(node.op, Window):
                windows.setdefault(node.op.state, []).append(index)
            for arg in node.args:
                users.setdefault(arg, set()).add(index)
    results = set(seen_values(program))
    found: dict[str, InPlace] = {}
    for state in program.states:
        if isinstance(state.origin, History | Tape):
            last = program.step[state.next]
            moved = Slice(WINDOW, 1, state.axes[-1].size + 1)
            # one window, and the next value is that window without its oldest sample: the samples
            # can be shifted in place
            if last.op == moved and [*last.args] == windows.get(state.name):
                (window,) = last.args
                read = users[window] != {state.next} or bool({window, state.next} & results)
                # an expression may also read the shifted window
                read = read or state.next in users
                found[state.name] = InPlace(program.step[window].args[0], read)
    return found


def doubles(ring: Ring, kept: int) -> bool:
    """True if a buffer of `kept` samples becomes a doubled ring under the option `ring`."""
    return ring == "double" or (ring == "auto" and kept > _LONGEST_SHIFT)


def member_place(
    base: str, identifier: str, shape: tuple[int, ...], *, pointer: bool = True
) -> ArrayView:
    """The place of a field of the struct variable `base`, which is a pointer unless `pointer` is
    False. It is a scalar field if the shape is empty, else an array.
    """
    field: c.Expression = c.Member(base, identifier, pointer)
    return ArrayView.array(field, shape) if shape else ArrayView.single(field)


def _last(window: ArrayView, shape: tuple[int, ...]) -> ArrayView:
    axis = len(window.shape) - 1
    size = window.shape[-1]
    place = window.sliced(axis, size - 1, size)
    return ArrayView(place.storage, shape, place.strides[:-1], place.offset)


def _along_time(newest: ArrayView, shape: tuple[int, ...]) -> ArrayView:
    return newest.repeated(shape, (*range(len(newest.shape)), None))
