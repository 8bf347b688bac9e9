"""Steps one instance of a model from Python, a sample at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c.functions.state_reports import BUFFERS_EMPTY, STATES_UNSET
from backends.c.interface.interface import Field, Interface
from backends.c.interface.status import StatusBit
from backends.ports.step_interface import Port
from msnn.stepping.engine import StepEngine
from msnn.stepping.places import (
    input_places,
    not_a_start,
    not_finite,
    numbers_of,
    output_places,
    refuses,
    shaped,
)
from spec_schema.diagnostics.suggest import nearest

Array = NDArray[Any]


class Stepper:
    """A model as it is deployed: memory of its own, a step a sample, the numbers of its C.

        s = msnn.stepper(model, result.weights)
        s.reset(x=0.1)
        y = s.step(F=2.0)["x_next"]

    Values have the units and shapes of the spec. What is wrong with them is a ValueError, and
    leaves the state as it was.
    """

    def __init__(
        self, engine: StepEngine, interface: Interface, name: str, sample_time: float | None
    ) -> None:
        self._engine, self._interface = engine, interface
        self.name = name
        self.engine = engine.name
        """`c` or `interpreter`: who steps."""
        self.sample_time = sample_time
        """Seconds between two steps; None where the spec does not say."""
        # kept beside: a step is a few microseconds, of which looking up attributes is a part
        self._call = engine.step
        self._memory, self._answers = engine.inputs, engine.outputs
        self._inputs = input_places(interface, engine.inputs)
        self._outputs = output_places(interface, engine.outputs)
        self._status = 0
        self._unset = bool(engine.waiting & STATES_UNSET)

    def step(self, **inputs: Any) -> dict[str, float | Array]:
        """The outputs of a sample, after which the model is one sample further.

        A name that no keyword can be, such as `car.u`, is given by `step(**{"car.u": 1.0})`.
        """
        places = self._inputs
        # all before anything is written: a mistake leaves the inputs as they were
        if inputs.keys() != places.keys():
            raise ValueError(_misnamed("step", places, inputs))
        if self._unset:
            raise ValueError(self._wanted())
        for name, value in inputs.items():
            place = places[name]
            if place.view is None:
                self._memory[place.index] = place.number(value)
            else:
                place.put(value)
        self._status = self._call()
        answers = self._answers
        return {
            # copied: the next step writes into the same memory
            place.name: answers[place.index] if place.view is None else place.view.copy()
            for place in self._outputs
        }

    @property
    def status(self) -> tuple[str, ...]:
        """The faults of the last step or reset, by the names of the C's status bits."""
        bits = StatusBit(self._status)
        # members that are one bit each have names
        return tuple(bit.name or "" for bit in StatusBit if bit in bits)

    def reset(self, **initial: ArrayLike) -> None:
        """Restarts the model from the first states of the spec, or from the values given here.

        `initial` are samples around the first step, which the spec's `init` reads, and states. A
        single sample is repeated over the window. A model whose first states come from the log
        alone needs all of its samples.
        """
        starts = {field.name: (field, port) for field, port in self._interface.windows}
        supplied = {field.name: field for field, _ in self._interface.supplied}
        shapes = self._shapes()
        # dictionaries for their order: messages list names as the spec has them
        known = {**dict.fromkeys((*starts, *supplied)), **dict.fromkeys(shapes)}
        if unknown := initial.keys() - known.keys():
            raise ValueError(_misnamed("reset", known, dict.fromkeys((*known, *unknown))))
        windows = {
            name: _window(initial[name], *starts[name]) for name in starts if name in initial
        }
        for name, field in supplied.items():
            if name in initial:
                windows[name] = _start(name, initial[name], field.shape)
        given = {
            name: _start(name, value, shapes[name])
            for name, value in initial.items()
            if name not in windows
        }
        # first states are computed of all samples together
        if windows and windows.keys() != {*starts, *supplied}:
            raise ValueError(self._wanted())
        # without samples the states that come of them have to be given themselves
        waiting = self._waiting_states()
        if not windows and not waiting <= given.keys():
            raise ValueError(self._wanted())
        if not windows:
            self._refuse_some_buffers(given)
        if windows:
            self._status = self._engine.reset(windows)
        else:
            self._engine.init()
            self._status = 0
        self._unset = False
        if given:
            self.state = given

    @property
    def state(self) -> dict[str, float | Array]:
        """All that the model remembers, by name; buffers oldest sample first."""
        found = self._engine.states()
        return {name: value if value.shape else float(value) for name, value in found.items()}

    @state.setter
    def state(self, values: Mapping[str, ArrayLike]) -> None:
        """Replaces what is given of it, in the shapes in which it is read."""
        shapes = self._shapes()
        if unknown := values.keys() - shapes.keys():
            raise ValueError(_misnamed("state", shapes, dict.fromkeys((*shapes, *unknown))))
        found = {name: _start(name, value, shapes[name]) for name, value in values.items()}
        if self._engine.waiting & BUFFERS_EMPTY:
            self._refuse_some_buffers(found)
            if self._interface.filled_by_first <= found.keys():
                self._engine.no_longer_waits(BUFFERS_EMPTY)
        self._engine.set_states({**self._engine.states(), **found})
        # all of them: a state half set is no beginning
        if self._waiting_states() <= found.keys():
            self._engine.no_longer_waits(STATES_UNSET)
            self._unset = False

    def _refuse_some_buffers(self, given: Mapping[str, ArrayLike]) -> None:
        """ValueError for some samples of the past without the others: the first step fills all."""
        empty = self._interface.filled_by_first
        if empty & given.keys() and not empty <= given.keys():
            missing = _listed(empty - given.keys())
            raise ValueError(f"no sample was stepped yet: give {missing} too")

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        return {name: value.shape for name, value in self._engine.states().items()}

    def _waiting_states(self) -> frozenset[str]:
        """The states that only samples, or somebody who knows them, can set."""
        return self._interface.from_record - self._interface.filled_by_first

    def _wanted(self) -> str:
        parts = [_described(field, port) for field, port in self._interface.windows]
        parts += [
            f"`{field.name}` (where that state starts, which training fits to each record)"
            for field, _ in self._interface.supplied
        ]
        states = self._waiting_states()
        ambiguous = states & {field.name for field, _ in self._interface.windows}
        # a signal and a state of one name: what is given under it is taken as samples
        instead = "" if ambiguous or not states else f", or the states {_listed(states)}"
        return f"`reset` wants {', '.join(parts)}{instead}: the first states come from these"


def _window(value: ArrayLike, field: Field, port: Port) -> Array:
    """The samples of a signal around the first step; a single sample is repeated over the window.

    Raises ValueError for other shapes, and for non-finite values if the signal flags them.
    """
    array = numbers_of(field.name, value)
    one = tuple(axis.size for axis in port.signal.axes)
    # one sample without the window's axis, which is the last (R3)
    if array.shape == one and array.shape != field.shape:
        array = np.broadcast_to(array[..., np.newaxis], field.shape)
    array = shaped(field.name, array, field.shape)
    if refuses(port.signal) and not np.isfinite(array).all():
        raise ValueError(not_finite(field.name, _first_not_finite(array)))
    return array


def _start(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The first value of a state."""
    array = shaped(name, value, shape)
    if not np.isfinite(array).all():
        raise ValueError(not_a_start(name, _first_not_finite(array)))
    return array


def _first_not_finite(array: Array) -> float:
    return float(array[~np.isfinite(array)][0])


def _described(field: Field, port: Port) -> str:
    if port.first == port.last:
        return f"`{field.name}`"
    first, last = (f"t{n:+d}" if n else "t" for n in (port.first, port.last))
    return f"`{field.name}` ({port.last - port.first + 1} samples, {first} … {last})"


def _misnamed(of: str, known: Iterable[str], given: Iterable[str]) -> str:
    known, given = list(known), list(given)
    said = [f"`{of}` takes {_listed(known) or 'nothing'}"]
    missing = [name for name in known if name not in given]
    if missing:
        said.append(
            f"{_listed(missing)} is missing"
            if len(missing) == 1
            else f"missing: {_listed(missing)}"
        )
    for name in (name for name in given if name not in known):
        meant = nearest(name, known)
        said.append(f"`{name}` is unknown" + (f", did you mean `{meant}`?" if meant else ""))
    return "; ".join(said)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in sorted(names))
