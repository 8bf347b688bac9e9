"""Runs both FMUs of an export: as simulation, and by single steps through the serialised state."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.c.host.library import StateStruct
from backends.c.interface.interface import Interface
from backends.c.interface.layout_metadata import layout_metadata
from backends.fmu.variable import Variable, VariableKind
from backends.fmu.variables import unit_variables
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Arrays, Beginning
from msnn.agreement.loaded import Loaded, stacked
from msnn.exports.running.fmu_instance import FmuInstance, UnfitUnitError, fmu_instance
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
        """Simulates with both units."""
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
        """Offset of the checksum."""
        return self.data.index(b"\0") + 1

    @property
    def memory(self) -> bytes:
        """The state struct."""
        begin = self._checksum + _CHECKSUM_BYTES
        return self.data[begin : begin + self.size]

    def replaced(self, memory: bytes) -> bytes:
        """The same data with another state struct and an updated checksum."""
        behind = self.data[self._checksum + _CHECKSUM_BYTES + self.size :]
        checksum = zlib.crc32(memory + behind).to_bytes(_CHECKSUM_BYTES, sys.byteorder)
        return self.data[: self._checksum] + checksum + memory + behind


_CHECKSUM_BYTES = 4
