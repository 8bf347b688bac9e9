"""Steps one instance of a model from Python, a sample at a time, in compiled C if possible."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c.functions.state_reports import BUFFERS_EMPTY, STATES_UNSET
from backends.c.interface.interface import Field, Interface, c_interface
from backends.c.interface.status import StatusBit
from backends.c_lowering.options import COptions
from backends.files.c_compiler import CompilerMissingError
from backends.ports.step_interface import Port
from compiler.ir.program import Program, Signal
from msnn.data.dataset import FloatArray
from msnn.errors.learning import engines
from msnn.exports.export import plan_exports
from msnn.exports.prepare import c_options
from msnn.exports.target import ExportPlan
from msnn.model.model import Model
from msnn.simulation.engines.kernel_check import NO_FALLBACK
from spec_schema.diagnostics.diagnostic import Findings, SpecError, describe
from spec_schema.diagnostics.suggest import nearest
from spec_schema.registry import ARITHMETICS


def open_stepper(model: Model, weights: Mapping[str, FloatArray]) -> Stepper:
    """Opens a model for stepping, as it would be exported to C.

    Without a compiler the interpreter is used, with a RuntimeWarning. Raises SpecError for an
    invalid export, or one in fixed point.
    """
    findings = Findings()
    # the numbers of what `msnn export --to c` writes, slices of 0 left out
    plans = plan_exports(model, ["c"], findings, weights=weights)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    (plan,) = plans
    if plan.dtype in ARITHMETICS:
        raise SpecError([engines.stepper_of_words(plan.dtype)], model.sources)
    plan = cast("ExportPlan[COptions]", plan)
    weights = plan.of(weights)
    interface = c_interface(plan.program, c_options(plan))
    engine: StepEngine
    try:
        # jinja2 and the emitter are loaded only where something is compiled
        from backends.native.native_step import NativeStep

        engine = NativeStep(plan.program, interface, weights)
    except CompilerMissingError as error:
        engine = _interpreted(str(error), plan.program, interface, weights)
    # a mistake of the emitter must not end a control loop in Python; the warning asks to report it
    except Exception as error:
        if os.environ.get(NO_FALLBACK):
            raise
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
        engine = _interpreted(reason, plan.program, interface, weights)
    return Stepper(engine, interface, model.name, model.program.sample_time)


def _interpreted(
    reason: str, program: Program, interface: Interface, weights: Mapping[str, FloatArray]
) -> StepEngine:
    from backends.c.host.interpreted_step import InterpretedStep

    said = describe(engines.interpreted_instead(reason))
    # shown at the line of the user's script that opened it
    warnings.warn(said, RuntimeWarning, stacklevel=4)
    return InterpretedStep(program, interface, weights)


Array = NDArray[Any]


class Stepper:
    """One instance of a model that computes one sample per call, with the same bits as its C
    export.

        s = msnn.stepper(model, result.weights)
        s.reset(x=0.1)
        y = s.step(F=2.0)["x_next"]

    Values have the units and shapes of the spec. An invalid value raises ValueError and leaves the
    state unchanged.
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
        """Computes one sample: takes the inputs by name, returns the outputs, and advances the
        states.

        A name that cannot be a keyword, such as `car.u`, is passed by `step(**{"car.u": 1.0})`.
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
        """The faults of the last step or reset, by the names of the status bits of the C code."""
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
        """All states and buffers by name; a buffer has its oldest sample first."""
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
    """The initial value of a state as an array.

    ValueError for another shape or a non-finite element.
    """
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


@dataclass(frozen=True, slots=True)
class RealsPlace:
    """One input or output in the memory of a compiled step: a scalar at `index`, or the array
    `view`.
    """

    name: str
    index: int
    view: Array | None
    refuses: bool = False
    """True if non-finite values are refused, because no policy replaces them."""

    def number(self, value: Any) -> float:
        """The value as float. ValueError if it is not a finite number."""
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise ValueError(f"`{self.name}` is a number, not {value!r}") from None
        if self.refuses and not isfinite(number):
            raise ValueError(not_finite(self.name, number))
        return number

    def put(self, value: ArrayLike) -> None:
        """Writes an array. ValueError for another shape, or non-finite elements."""
        assert self.view is not None
        array = shaped(self.name, value, self.view.shape)
        if self.refuses and not np.isfinite(array).all():
            raise ValueError(not_finite(self.name, array[~np.isfinite(array)][0]))
        with np.errstate(over="ignore"):  # too large for float32: the step says so
            self.view[...] = array


def numbers_of(name: str, value: ArrayLike) -> Array:
    """The value as array. ValueError if it is not numeric."""
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"`{name}` is not made of numbers: {value!r}") from None


def shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The value as array. ValueError for another shape."""
    array = numbers_of(name, value)
    if array.shape != shape:
        raise ValueError(f"`{name}` has shape {array.shape}, not {shape}")
    return array


def not_finite(name: str, value: float) -> str:
    """The message for a refused value, with the policies that would accept it."""
    return (
        f"`{name}` is {value}: `on_invalid: clamp` or `hold` of the input replaces such values, "
        "`trust` lets them pass"
    )


def not_a_start(name: str, value: float) -> str:
    """The message for an invalid initial state."""
    return f"`{name}` is {value}: no step brings a state back that is not finite; give a number"


def refuses(signal: Signal) -> bool:
    """True if the C code would report non-finite values but still use them."""
    # `clamp` and `hold` replace such a value in C; `trust` promises that there is none
    return signal.on_invalid == "flag"


def input_places(interface: Interface, memory: Any) -> dict[str, RealsPlace]:
    """The places of the step's inputs in `memory`, by name."""
    fields = [input.field for input in interface.inputs]
    checked = {input.field.name: refuses(input.port.signal) for input in interface.inputs}
    return {
        place.name: RealsPlace(place.name, place.index, place.view, checked[place.name])
        for place in _places(fields, memory, interface)
    }


def output_places(interface: Interface, memory: Any) -> tuple[RealsPlace, ...]:
    """The places of the step's outputs in `memory`."""
    return tuple(_places(interface.outputs, memory, interface))


def _places(fields: Iterable[Field], memory: Any, interface: Interface) -> Iterable[RealsPlace]:
    # a view of the memory of ctypes: writing to it is writing the struct
    numbers = np.frombuffer(memory, interface.options.dtype)
    begin = 0
    for field in fields:
        view = numbers[begin : begin + field.size].reshape(field.shape) if field.shape else None
        yield RealsPlace(field.name, begin, view)
        begin += field.size


StepsBy: TypeAlias = Literal["c", "interpreter"]
"""The compiled C code of the export, or the interpreter in the same arithmetic."""


class StepEngine(Protocol):
    """One instance of a model in compiled C or in the interpreter.

    `inputs` and `outputs` are ctypes arrays, field after field.
    """

    inputs: Any
    outputs: Any

    @property
    def name(self) -> StepsBy:
        """The name of the engine: compiled C or the interpreter."""
        ...

    @property
    def step(self) -> Callable[[], int]:
        """Computes outputs from the inputs, and the next states; returns status bits."""
        ...

    @property
    def waiting(self) -> int:
        """The status bits BUFFERS_EMPTY and STATES_UNSET, if buffers or states have no
        values yet.
        """
        ...

    def init(self) -> None:
        """Sets those states whose initial values need no data."""
        ...

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states from samples around the first step; returns status bits."""
        ...

    def states(self) -> dict[str, Array]:
        """The values of all states and buffers, by name."""
        ...

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states and buffers."""
        ...

    def no_longer_waits(self, bits: int) -> None:
        """Clears status bits in `waiting`, after states were set."""
        ...
