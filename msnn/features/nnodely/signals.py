"""Classifies a window of an input: recorded samples, a state, or a connected value."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from msnn.features.nnodely.errors import fed_back_late, rounded_window, starts_at_zero
from msnn.features.nnodely.json_text import JsonText
from msnn.features.nnodely.names import TakenNames
from msnn.features.nnodely.saved_model import File, Input
from msnn.features.nnodely.terms import Signal, Term
from msnn.features.nnodely.values import ShapeError, Value, ValueOperations, refuse_many
from spec_schema.diagnostics.diagnostic import Findings

# buffers of windows (`_sw`), integrals and derivatives, by nnodely's names for them
_HIDDEN = re.compile(r".*_(sw|tw|int|der)\d+")


@dataclass(frozen=True, slots=True)
class Window:
    """The samples of an input that nnodely stores: `back` samples up to the current one, `ahead`
    samples after it.
    """

    back: int
    ahead: int

    @property
    def length(self) -> int:
        return self.back + self.ahead


@dataclass(frozen=True, slots=True)
class Loops:
    """Facts about closed inputs that are discovered during a translation and used by the
    next one.
    """

    widths: dict[str, int] = field(default_factory=dict[str, int])
    """Number of samples of a feedback, if it is more than one."""
    ahead: set[str] = field(default_factory=set[str])
    """Inputs whose future samples the model reads."""


class OtherLoopError(Exception):
    """A closed loop differs from what was assumed; the model is to be translated again."""


@dataclass(slots=True, kw_only=True)
class Signals:
    """Translates inputs of the file to inputs, states and stored equations of the spec, which it
    collects. Numbers in `inputs` and `targets` are their elements.
    """

    file: File
    text: JsonText
    names: TakenNames
    values: ValueOperations
    findings: Findings
    value_of: Callable[[str], Value]
    known: Loops
    inputs: dict[str, int] = field(default_factory=dict[str, int])
    states: dict[str, tuple[Term, int]] = field(default_factory=dict[str, "tuple[Term, int]"])
    equations: dict[str, Term] = field(default_factory=dict[str, Term])
    """Equations whose past is stored; it is 0 before the start."""
    scoring: bool = False
    """True while losses are evaluated, which read recorded values."""
    targets: dict[str, int] = field(default_factory=dict[str, int])
    loops: list[str] = field(default_factory=list[str])
    """Closed inputs whose next values are still to be evaluated."""
    predicted: dict[str, int] = field(default_factory=dict[str, int])
    """Inputs that start from data and are predicted by an output, with the number of steps
    ahead.
    """

    def window(self, name: str) -> Window:
        """The union of an input's windows in the file, in samples. Raises ShapeError if it has
        none, or an empty or very long one.
        """
        given = self.file.Inputs[name]
        back: list[int] = []
        ahead: list[int] = []
        if given.tw is not None:
            back.append(self.samples(name, -given.tw[0]))
            ahead.append(self.samples(name, given.tw[1]))
        if given.sw is not None:
            back.append(-given.sw[0])
            ahead.append(given.sw[1])
        if not back:
            raise ShapeError(f"the input `{name}` has no window")
        found = Window(max(back), max(ahead))
        if found.length < 1:
            raise ShapeError(f"the window of `{name}` is empty")
        return found

    def samples(self, name: str, seconds: float) -> int:
        """A duration of the input `name` in samples, rounded like in nnodely, with a warning.
        Raises ShapeError beyond a million samples.
        """
        step = self.file.Info.SampleTime
        # before it is rounded: a window of the file may be any number
        if abs(seconds / step) > 1e6:
            raise ShapeError(f"a window of `{name}` has more than 1,000,000 samples")
        count = round(seconds / step)
        if abs(seconds / step - count) > 1e-6:
            place = self.text.place("Inputs", name)
            self.findings.report(rounded_window(name, abs(seconds), abs(count), place))
        return count

    def read(self, name: str, first: int, end: int) -> Value:
        """The samples of an input from `first` to `end` in nnodely's counting: [−1, 0] is the
        current one.

        Raises ShapeError if they are not in the input's window, and OtherLoopError if a fed-back
        input turns out to need states.
        """
        given = self.file.Inputs[name]
        kept = self.window(name)
        if not (-kept.back <= first < end <= kept.ahead):
            raise ShapeError(f"[{first}, {end}] is no part of the window of `{name}`")
        # counted from the oldest sample that nnodely keeps of the input
        slots = (kept.back + first, kept.back + end)
        if given.connect is not None:
            return self._spread(name, self._connected(name, given.connect, kept.length, slots))
        # losses are of the log, whatever a rollout feeds back
        if given.closed_loop is None or self.scoring:
            return self._logged(name, first, end)
        if name not in self.loops:
            self.loops.append(name)
        width = self.known.widths.get(name, 1)
        is_one = width == 1 and name not in self.known.ahead
        if is_one and self._is_logged(name, given) and kept.ahead >= 0:
            if end > 0:
                self.known.ahead.add(name)
                # the future of a fed-back signal is not in the log: the input has to become states
                # after all
                raise OtherLoopError
            if kept.ahead > 0 and name not in self.predicted:
                place = self.text.place("Inputs", name)
                self.findings.report(fed_back_late(self._new(name), kept.ahead, place))
            # nnodely puts the new value behind the newest sample that it keeps, future ones
            # included
            self.predicted[name] = 1 + kept.ahead
            return self._logged(name, first, end)
        if self._is_logged(name, given):
            place = self.text.place("Inputs", name)
            self.findings.report(starts_at_zero(self._new(name), place))
        refuse_many(end - first if width > 1 else 1)
        if width == 1:
            return self._state(name, kept.length, slots)
        pieces = [self._slot(name, kept.length, width, k) for k in range(*slots)]
        # several samples replaced at once: each of the newest is a state of its own
        return Value(len(pieces), given.dim, tuple(pieces))

    def close(self, name: str, value: Value) -> None:
        """Defines the next value of the closed input `name`; several samples replace its newest
        ones together.

        Raises ShapeError if sizes do not fit, and OtherLoopError for another number of samples than
        was assumed.
        """
        given = self.file.Inputs[name]
        width = self.known.widths.get(name, 1)
        if value.window != width:
            if value.window > self.window(name).length:
                raise ShapeError(f"what closes `{name}` has more samples than it")
            self.known.widths[name] = value.window
            # the window is known now; what was followed with the shorter one is not right
            raise OtherLoopError
        if value.dim not in {1, given.dim}:
            raise ShapeError(f"what closes `{name}` has {value.dim} elements, not {given.dim}")
        # closed by the output that predicts it: no state
        if name in self.predicted:
            return
        for k in range(width):
            sample = self.values.samples(value, k, k + 1)
            term = self._spread(name, sample).pieces[0]
            self.states[self._kept(name, width, k)] = (term, given.dim)

    def _logged(self, name: str, first: int, end: int) -> Value:
        size = self.file.Inputs[name].dim
        if not self.scoring:
            self.inputs[name] = size
        elif name not in self.inputs:
            self.targets[name] = size
        window = end - first if end - first > 1 else None
        term = Term(Signal(self._new(name), first + 1, end), (), window, size)
        return Value(end - first, size, (term,))

    def _state(self, name: str, length: int, slots: tuple[int, int]) -> Value:
        first, end = slots
        size = self.file.Inputs[name].dim
        window = end - first if end - first > 1 else None
        # the newest slot is the state's current value, t
        head = Signal(self._kept(name, 1, 0), first + 1 - length, end - length)
        return Value(end - first, size, (Term(head, (), window, size),))

    def _slot(self, name: str, length: int, width: int, slot: int) -> Term:
        """One sample of a buffer of `length` samples (`slot`, oldest first) of which each step
        replaces the newest `width`; each of these is a state.
        """
        # the newest sample is slot length − 1; the last `width` slots are states of their own,
        # older ones are their past
        newest = slot - (length - width)
        size = self.file.Inputs[name].dim
        head = Signal(self._kept(name, width, max(newest, 0)), min(newest, 0), min(newest, 0))
        return Term(head, (), None, size)

    def _connected(self, name: str, source: str, length: int, slots: tuple[int, int]) -> Value:
        value = self.value_of(source)
        # only the newest samples fit into a buffer that is shorter than what feeds it
        width = min(value.window, length)
        newest = self.values.samples(value, value.window - width, value.window)
        old = length - width
        first, end = slots
        late = None
        # slots from `old` on are of this step; those before are what the same values were earlier
        if end > old:
            late = self.values.samples(newest, max(first, old) - old, end - old)
        if first >= old and late is not None:
            return late
        oldest = self.values.samples(newest, 0, 1)
        # a buffer moves on by one sample a step: what lies `width` and more back is the oldest one,
        # delayed
        past = self._past(name, oldest, first - old, min(end, old) - old - 1)
        return past if late is None else self.values.after(past, late)

    def kept_past(self, name: str) -> Value:
        """The value that is connected to the input `name`, as a window of one sample of an equation
        whose past is stored, 0 before the start. Raises ShapeError for several samples.
        """
        source = self.file.Inputs[name].connect
        assert source is not None
        value = self.value_of(source)
        if value.window != 1:
            raise ShapeError(f"`{name}` is fed more than one sample")
        return self._past(name, value, 0, 0)

    def _past(self, name: str, oldest: Value, first: int, last: int) -> Value:
        """The samples t + first … t + last of the value `oldest`, which becomes an equation whose
        past is stored; it is 0 before the start.
        """
        size = self.file.Inputs[name].dim
        new = self._new(name)
        self.equations[new] = self._spread(name, oldest).pieces[0]
        window = last - first + 1 if last > first else None
        term = Term(Signal(new, first, last), (), window, size)
        return Value(last - first + 1, size, (term,))

    def _spread(self, name: str, value: Value) -> Value:
        """The value for the input `name`; a scalar is repeated for each element. Raises ShapeError
        for other sizes.
        """
        size = self.file.Inputs[name].dim
        if value.dim == size:
            return value
        if value.dim != 1:
            raise ShapeError(f"`{name}` has {size} elements, not {value.dim}")
        return self.values.stacked([value] * size)

    def _is_logged(self, name: str, given: Input) -> bool:
        return not (given.local and _HIDDEN.fullmatch(name))

    def _kept(self, name: str, width: int, k: int) -> str:
        new = self._new(name)
        # a target may have the name of the input itself
        is_named = width == 1 and name not in self.known.ahead
        return new if is_named else self.names.of("sample", f"{new}_{k}")

    def _new(self, name: str) -> str:
        return self.names.of("input", name)
