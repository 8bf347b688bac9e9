"""Runs a program in the interpreter with the input policies and status bits of its C code."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c.functions.state_reports import BUFFERS_EMPTY, STATES_UNSET
from backends.c.interface.interface import Field, Interface
from backends.c.interface.status import StatusBit
from backends.c.selftest.reference_step import (
    apply_policy,
    apply_policy_to_window,
    emptied,
    equation_bits,
    filled_by_first,
    first_held,
    first_state_bits,
    log_of_steps,
    next_state_bits,
    restarted,
    saturation_bits,
    with_checked,
)
from backends.c_language.literals import Dtype
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program

Array = NDArray[Any]


class InterpretedStep:
    """One instance of a program in step form, computed by the interpreter with the arithmetic,
    input policies and status bits of its C code. `inputs` and `outputs` are memory that the caller
    writes and reads: arrays of reals (ctypes), field after field in the order of the interface.
    """

    name: Literal["c", "interpreter"] = "interpreter"

    def __init__(
        self, program: Program, interface: Interface, weights: Mapping[str, ArrayLike]
    ) -> None:
        self._program, self._interface = program, interface
        self._dtype: Dtype = interface.options.dtype
        real = ctypes.c_float if self._dtype == "float32" else ctypes.c_double
        # at least one: numpy cannot view an empty buffer
        self.inputs = (real * max(sum(input.field.size for input in interface.inputs), 1))()
        self.outputs = (real * max(sum(field.size for field in interface.outputs), 1))()
        self._given = _parts(self.inputs, [input.field for input in interface.inputs], self._dtype)
        self._answers = _parts(self.outputs, interface.outputs, self._dtype)
        self._judge = Interpreter(with_checked(program), weights, self._dtype)
        supplied = {state.name for _, state in interface.supplied}
        self._supplied = supplied
        computed = tuple(state for state in program.states if state.name not in supplied)
        known = tuple(s for s in program.states if s.name not in interface.from_record)
        bare = replace(program, losses=(), outputs=())
        self._from_record = Interpreter(replace(bare, states=computed), weights, self._dtype)
        self._without = Interpreter(replace(bare, states=known), weights, self._dtype)
        self._states: dict[str, Array] = {}
        self._first: dict[str, Array] = {}
        self._seen: dict[str, Array] = {}
        self.waiting = 0
        """The bits of the field `ready` in C."""
        self.init()

    def init(self) -> None:
        """Sets the states that need no recorded samples, as `init` in C; the others become 0."""
        interface = self._interface
        zeros = {
            state.name: np.zeros((1, *(axis.size for axis in state.axes)), self._dtype)
            for state in self._program.states
        }
        # without a log, like `init` in C
        known = self._without.start({}, 0)
        self._states = {name: known.get(name, value) for name, value in zeros.items()}
        self._states = emptied(interface, self._states)
        self._begin()
        self.waiting = BUFFERS_EMPTY if interface.filled_by_first else 0
        self.waiting |= STATES_UNSET if interface.from_record - interface.filled_by_first else 0

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states from samples around the first step; returns status bits. `windows` has a
        value for each argument of `reset`, by name: samples with time as last axis, or a supplied
        state. Raises KeyError if one is missing.
        """
        bits = StatusBit(0)
        ports = {field.name: port for field, port in self._interface.windows}
        # the row of the first step, so that the oldest sample of any port is in row 0 or later
        row = max([0, *(-port.first for port in ports.values())])
        log: dict[str, Array] = {}
        for name, port in ports.items():
            values = np.asarray(windows[name], self._dtype)
            single = port.first == port.last
            samples = values[np.newaxis] if single else np.moveaxis(values, -1, 0)
            checked, said = apply_policy_to_window(port.signal, samples, self._dtype)
            # zeros outside the window, which no start reads
            log[name] = np.zeros((row + max(port.last, 0) + 1, *checked.shape[1:]), self._dtype)
            log[name][row + port.first : row + port.last + 1] = checked
            bits |= said
        self._states = self._from_record.start(log, row)
        for name in self._supplied:
            self._states[name] = np.asarray(windows[name], self._dtype)[np.newaxis]
        self._begin()
        self.waiting = 0
        return int(bits | first_state_bits(self._interface, self._states))

    def step(self) -> int:
        """Runs one step: reads the memory `inputs`, writes `outputs`, and returns status bits."""
        bits = StatusBit(0)
        for input in self._interface.inputs:
            name, signal = input.field.name, input.port.signal
            given = self._given[name].copy()
            self._seen[name], said = apply_policy(signal, given, self._seen[name], self._dtype)
            bits |= said
        once = {name: value[np.newaxis] for name, value in self._seen.items()}
        log, row = log_of_steps(self._interface, once, 1)
        if self.waiting & STATES_UNSET:
            bits |= StatusBit.UNINITIALISED
        if self.waiting & BUFFERS_EMPTY:
            self._states = filled_by_first(
                self._judge, self._interface, self._states, (log, row), [0]
            )
            self.waiting &= ~BUFFERS_EMPTY
        values = self._judge.step(log, row, self._states, losses=False)
        for name, place in self._answers.items():
            place[...] = values.outputs[name][0]
        bits |= equation_bits(self._program, values.outputs, self._dtype)
        bits |= saturation_bits(self._program, values.outputs)
        bits |= next_state_bits(self._interface, values.next_states)
        again = restarted(self._interface, values.next_states, self._first)
        # after the status bits, which describe the computed states
        self._states = {**values.next_states, **again}
        return int(bits)

    def states(self) -> dict[str, Array]:
        """Copies of the current states by name, each with the shape of the spec."""
        return {name: np.array(value[0]) for name, value in self._states.items()}

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Replaces all states by `values`, by name. Raises KeyError if one is missing, ValueError
        for a wrong number of elements.
        """
        self._states = {
            name: np.array(values[name], self._dtype).reshape(value.shape)
            for name, value in self._states.items()
        }

    def no_longer_waits(self, bits: int) -> None:
        """Clears these bits of `waiting`: the states or buffers that they mean now have valid
        values.
        """
        self.waiting &= ~bits

    def _begin(self) -> None:
        """Stores the initial values of states with `on_range: reset`, and sets the values that
        policy `hold` uses before the first valid input.
        """
        restarting = {s.name for s in self._program.states if s.on_range == "reset"}
        self._first = {n: value for n, value in self._states.items() if n in restarting}
        self._seen = {
            input.field.name: first_held(input.port.signal, input.field.shape, self._dtype)
            for input in self._interface.inputs
        }


def _parts(memory: Any, fields: Iterable[Field], dtype: Dtype) -> dict[str, Array]:
    """Views of the fields by name, in their shapes, in a block of memory that holds them one after
    the other. Writing to a view changes the memory.
    """
    numbers = np.frombuffer(memory, dtype)
    found: dict[str, Array] = {}
    begin = 0
    for field in fields:
        found[field.name] = numbers[begin : begin + field.size].reshape(field.shape)
        begin += field.size
    return found
