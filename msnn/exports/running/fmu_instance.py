"""Runs a Functional Mock-up Unit with FMPy, with the same interface for both FMI versions."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.files.atomic_write import naming
from msnn.errors.failures import MissingExtraError

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
    """One instance; `messages` is its log. FMPy raises an error if a call is refused."""

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
        """Resets the instance and enters initialisation mode."""
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
        """Reads the elements of a variable."""
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
        """Executes step `number` since the start."""
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
