"""Runs both FMUs of an export: as simulation, and by single steps through the serialised state."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.host.library import StateStruct
from backends.c.interface.interface import Interface
from backends.c.interface.layout_metadata import layout_metadata
from backends.files.atomic_write import naming
from backends.fmu.variable import Variable, VariableKind
from backends.fmu.variables import unit_variables
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judgement import Arrays, Beginning, Loaded, stacked
from msnn.errors.failures import MissingExtraError
from msnn.exports.target import Written


@contextmanager
def loaded_fmu(program: Program, interface: Interface, written: Written) -> Generator[Loaded]:
    """Runs the FMI 3.0 unit; in simulations, the FMI 2.0 unit must give the same bits."""
    with ExitStack() as stack:
        paths = sorted(path for path in written.files if path.suffix == ".fmu")
        # the names differ in the version alone, so that sorted 2.0 comes first
        second, third = (stack.enter_context(fmu_instance(path)) for path in paths)
        model = _FmuModel(program, interface, second, third)
        yield Loaded(model.run, model.start, model.step_each)


class _FmuModel:
    def __init__(
        self, program: Program, interface: Interface, second: FmuInstance, third: FmuInstance
    ) -> None:
        # places and shapes alone are asked of these: initial values do
        weights = physical_weights(program, {})
        self._interface, self._second, self._third = interface, second, third
        self._seconds = 1.0 if program.sample_time is None else program.sample_time
        self._by_place = {v.place: v for v in unit_variables(program, interface, weights).all}
        self._memory = StateStruct(layout_metadata(program, interface, weights)["c"])

    def run(self, beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        """Simulates with both FMUs; returns the outputs. Their bits must be equal."""
        found = self._run(self._third, beginning, inputs, steps)
        other = self._run(self._second, beginning, inputs, steps)
        for name, values in found.items():
            # FMI 2.0 hands over doubles: in single precision they are widened, and rounding back
            # changes none
            if values.tobytes() != other[name].astype(values.dtype).tobytes():
                raise UnfitUnitError(f"the units of FMI 2.0 and 3.0 differ in `{name}`")
        return found

    def start(self, beginning: Beginning) -> Arrays:
        """The initial states computed from the samples around the first step."""
        self._begin(self._third, beginning)
        _, memory = self._state()
        return {name: value[np.newaxis] for name, value in self._memory.values(memory).items()}

    def step_each(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        """Single steps from states written into the serialised state of a started unit."""
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            self._set_states({name: values[k] for name, values in states.items()})
            found = self._step(self._third, {name: v[k] for name, v in inputs.items()}, k)
            outputs.append(found)
            following.append(self._memory.values(self._state()[1]))
        return stacked(outputs), stacked(following)

    def _run(self, unit: FmuInstance, beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        self._begin(unit, beginning)
        return stacked(
            [self._step(unit, {n: v[k] for n, v in inputs.items()}, k) for k in range(steps)]
        )

    def _begin(self, unit: FmuInstance, beginning: Beginning) -> None:
        interface = self._interface
        unit.initialise()
        for field, port in interface.windows:
            samples = beginning.window(field.name, port.first, port.last - port.first + 1)
            unit.set(self._at(VariableKind.SAMPLES, field.identifier).first, samples)
        for field, state in interface.supplied:
            at = self._at(VariableKind.SAMPLES, field.identifier)
            unit.set(at.first, beginning.states[state.name])
        unit.begin()

    def _step(self, unit: FmuInstance, inputs: Arrays, number: int) -> Arrays:
        for input in self._interface.inputs:
            at = self._at(VariableKind.INPUT, input.field.identifier)
            unit.set(at.first, inputs[input.field.name])
        unit.step(number, self._seconds)
        return {
            field.name: unit.get(self._at(VariableKind.OUTPUT, field.identifier).first, field.shape)
            for field in self._interface.outputs
        }

    def _at(self, kind: VariableKind, identifier: str) -> Variable:
        struct = {VariableKind.INPUT: "u", VariableKind.OUTPUT: "y", VariableKind.SAMPLES: "x0"}[
            kind
        ]
        return self._by_place[f"{struct}.{identifier}"]

    def _state(self) -> tuple[_Serialised, Any]:
        """The serialised state of the unit, and its state struct as a numpy record."""
        parts = _Serialised(self._third.state, self._memory.struct.dtype.itemsize)
        return parts, np.frombuffer(parts.memory, self._memory.struct.dtype).copy()[0]

    def _set_states(self, values: Arrays) -> None:
        # of an instance that has begun: token and what is behind stay as they are
        parts, memory = self._state()
        self._memory.fill(memory, values)
        self._third.state = parts.replaced(memory.tobytes())


@dataclass(frozen=True, slots=True)
class _Serialised:
    """The layout of a serialised state: a zero-terminated token, a checksum, the state struct, the
    rest.
    """

    data: bytes
    size: int

    @property
    def _checksum(self) -> int:
        """The offset of the checksum in the serialised state."""
        return self.data.index(b"\0") + 1

    @property
    def memory(self) -> bytes:
        """The bytes of the C state struct."""
        begin = self._checksum + _CHECKSUM_BYTES
        return self.data[begin : begin + self.size]

    def replaced(self, memory: bytes) -> bytes:
        """The same data with another state struct and an updated checksum."""
        behind = self.data[self._checksum + _CHECKSUM_BYTES + self.size :]
        checksum = zlib.crc32(memory + behind).to_bytes(_CHECKSUM_BYTES, sys.byteorder)
        return self.data[: self._checksum] + checksum + memory + behind


_CHECKSUM_BYTES = 4


Array = NDArray[Any]


class UnfitUnitError(Exception):
    """FMPy reports that a unit violates the FMI standard."""


@contextmanager
def fmu_instance(path: Path) -> Generator[FmuInstance]:
    """An instance of the FMU in an archive, which FMPy validates first.

    Raises MissingExtraError if it has no binary for this platform, and UnfitUnitError.
    """
    fmpy: Any = import_module("fmpy")
    validate_fmu: Any = import_module("fmpy.validation").validate_fmu
    # FMPy's own reading of the standard: a second opinion on the XML
    if problems := validate_fmu(str(path)):
        raise UnfitUnitError(f"{path.name}: {'; '.join(problems)}")
    # FMI 2.0 and 3.0 name platforms differently
    if not {fmpy.platform, fmpy.platform_tuple} & set(fmpy.supported_platforms(str(path))):
        raise MissingExtraError("a C compiler", "apt install gcc, or set CC, and export again")
    with TemporaryDirectory(prefix="msnn-fmu-") as place:
        with naming(Path(place)):
            fmpy.extract(str(path), place)
        instance = FmuInstance(fmpy.read_model_description(place, validate=False), place)
        try:
            yield instance
        finally:
            instance.close()


class FmuInstance:
    """An instance of an FMU, called through FMPy, which raises an error if a call is refused.

    `messages` is its log.
    """

    def __init__(self, description: Any, folder: str) -> None:
        fmi2: Any = import_module("fmpy.fmi2")
        fmi3: Any = import_module("fmpy.fmi3")
        self.messages: list[str] = []
        self.description = description
        self._is_3 = str(description.fmiVersion).startswith("3")
        kind: Any = fmi3.FMU3Slave if self._is_3 else fmi2.FMU2Slave
        types = {variable.type for variable in description.modelVariables}
        self.dtype = np.dtype("float32" if "Float32" in types else "float64")
        """The type of exchanged numbers."""
        # FMI 3.0 has a type for each width, FMI 2.0 doubles alone
        self._number = "Real" if not self._is_3 else self.dtype.name.capitalize()
        self._fmu: Any = kind(
            guid=description.guid,
            modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=folder,
            instanceName="msnn",
        )
        if self._is_3:
            self._fmu.instantiate(logMessage=self._hear)
        else:
            # kept in the instance: the unit calls them as long as it lives, and ctypes frees what
            # nobody holds
            self._callbacks = fmi2.fmi2CallbackFunctions()
            self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._hear)
            self._callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            self._callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            self._fmu.instantiate(callbacks=self._callbacks)

    def initialise(self) -> None:
        """Resets the FMU instance and enters initialisation mode, in which initial samples
        are set.
        """
        self._fmu.reset()
        if not self._is_3:
            # gone in FMI 3.0, mandatory in 2.0
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()

    def begin(self) -> None:
        """Leaves initialisation mode, which computes the initial states."""
        self._fmu.exitInitializationMode()

    def set(self, first: int, values: Array) -> None:
        """Sets the elements of the variable with this first value reference."""
        numbers = np.asarray(values, self.dtype).ravel()
        self._call("set", self._references(first, numbers.size), numbers.tolist())

    def get(self, first: int, shape: Sequence[int]) -> Array:
        """The elements of the variable with this first value reference, as an array of `shape`."""
        size = int(np.prod(shape, dtype=int))
        references = self._references(first, size)
        # FMI 3.0 wants the number of values beside the references, as one may stand for an array
        found = self._call("get", references, *((size,) if self._is_3 else ()))
        return np.array(found, self.dtype).reshape(shape)

    def count(self, reference: int) -> int:
        """Reads the integer with this value reference."""
        if self._is_3:
            (found,) = self._fmu.getUInt32([reference], 1)
        else:
            (found,) = self._fmu.getInteger([reference])
        return int(found)

    def step(self, number: int, seconds: float) -> None:
        """Computes step `number`, counted from the start; `seconds` is the sample time."""
        self._fmu.doStep(number * seconds, seconds)

    def end(self) -> None:
        """Terminates the simulation; a reset starts another."""
        self._fmu.terminate()

    def slopes(self, unknowns: Mapping[int, int], knowns: Mapping[int, Array]) -> Array:
        """Directional derivatives: changes of unknowns (by size) for given changes of knowns."""
        rows = [r for first, size in unknowns.items() for r in self._references(first, size)]
        columns = [r for first, v in knowns.items() for r in self._references(first, v.size)]
        seeds = np.concatenate([values.ravel() for values in knowns.values()]).tolist()
        # FMI 3.0 has arrays: their lengths are told beside the references
        sizes = (sum(unknowns.values()),) if self._is_3 else ()
        return np.array(self._fmu.getDirectionalDerivative(rows, columns, seeds, *sizes))

    @property
    def state(self) -> bytes:
        """The complete serialised state."""
        fmu = self._fmu
        state = fmu.getFMUState() if self._is_3 else fmu.getFMUstate()
        found = (fmu.serializeFMUState if self._is_3 else fmu.serializeFMUstate)(state)
        (fmu.freeFMUState if self._is_3 else fmu.freeFMUstate)(state)
        return bytes(found)

    @state.setter
    def state(self, data: bytes) -> None:
        fmu = self._fmu
        state = (fmu.deserializeFMUState if self._is_3 else fmu.deSerializeFMUstate)(data)
        (fmu.setFMUState if self._is_3 else fmu.setFMUstate)(state)
        (fmu.freeFMUState if self._is_3 else fmu.freeFMUstate)(state)

    def close(self) -> None:
        """Frees the instance and its library."""
        self._fmu.freeInstance()

    def _references(self, first: int, size: int) -> list[int]:
        # in FMI 2.0 each number of an array is a variable of its own, numbered in their order
        return [first] if self._is_3 else list(range(first, first + size))

    def _call(self, verb: str, *arguments: Any) -> Any:
        return getattr(self._fmu, f"{verb}{self._number}")(*arguments)

    def _hear(self, *told: Any) -> None:
        """Logs a message, which is the last argument of both logger interfaces."""
        message = told[-1]
        self.messages.append(message.decode() if isinstance(message, bytes) else str(message))
