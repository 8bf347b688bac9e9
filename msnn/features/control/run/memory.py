"""Keeps what a predictive controller knows of the plant's memory from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.nodes import reads_log
from compiler.ir.program import History, Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import by_name
from msnn.features.control.problem.optimal_control.horizon import Array, Given, log_of
from msnn.features.control.problem.optimal_control.problem import ControlProblem


class Memory:
    """The states of the plant by name: measured, predicted from the sample before, or not known."""

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        # nothing but next states is computed from sample to sample
        self._interpreter = Interpreter(replace(problem.program, outputs=()))
        self._registers = problem.registers
        self._shapes = {m.name: Type(m.axes).shape for m in problem.states.members}
        self._known: dict[str, Array] = {}
        self.forget()

    def forget(self) -> None:
        """As before the first sample: known is what starts at a value that no log has."""
        program = self._problem.program
        alone = [s for s in program.states if not reads_log(program.start, s.start)]
        # a register begins with the first sample of its signal, once that is known (R13)
        alone = [state for state in alone if state.name not in self._registers]
        start = Interpreter(replace(program, states=tuple(alone), outputs=()))
        self._known = {name: value[0] for name, value in start.start({}, 0).items()}

    @property
    def is_complete(self) -> bool:
        return self._known.keys() == self._shapes.keys()

    @property
    def known(self) -> Mapping[str, Array]:
        """The known values by name; a later sample changes none of these arrays."""
        return dict(self._known)

    def restore(self, known: Mapping[str, Array]) -> None:
        """Goes back to what was known of all that is not finite now."""
        for name, value in tuple(self._known.items()):
            if np.all(np.isfinite(value)):
                continue
            del self._known[name]
            if name in known:
                self._known[name] = known[name]

    def measure(self, values: Mapping[str, ArrayLike]) -> None:
        """Takes states, and signals that outputs predict, as measured at t.

        A shift register that nothing is known of begins with this sample at every place.
        """
        fed = {o.signal: n for n, o in self._registers.items() if isinstance(o, Tape)}
        for name, value in values.items():
            # the newest part of a tape is what outputs predicted: measured samples replace it
            array = np.asarray(value, np.float64)
            if name in self._shapes:
                self._known[name] = _of_shape(name, array, self._shapes[name])
            elif name in fed:
                tape = fed[name]
                origin, shape = self._registers[tape], self._shapes[tape]
                assert isinstance(origin, Tape)
                sample = _of_shape(name, array, shape[:-1])
                register = self._known.get(tape)
                if register is None:
                    register = np.repeat(sample[..., None], shape[-1], axis=-1)
                # the tape ends with the sample t + ahead − 1
                at = max(shape[-1] - origin.ahead, 0)
                register = register.copy()
                register[..., at] = sample
                self._known[tape] = register
            else:
                known = sorted({*self._shapes, *fed} - {*fed.values()})
                raise ValueError(f"no state or fed-back signal `{name}`; there are {known}")

    def begin(self, samples: Mapping[str, Array]) -> None:
        """Fills registers that nothing is known of with the samples of their signals at t."""
        for name, origin in self._registers.items():
            if name not in self._known and isinstance(origin, History) and origin.source in samples:
                sample = samples[origin.source]
                length = self._shapes[name][-1]
                self._known[name] = np.repeat(sample[..., None], length, axis=-1)

    def vector(self) -> Array:
        """x, once all is known."""
        parts = [np.ravel(self._known[m.name]) for m in self._problem.states.members]
        return np.concatenate([*parts, np.empty(0)])

    def advance(self, given: Given, controls: Array) -> None:
        """Predicts what is known at t+1, after these controls (nu) were applied."""
        # one row is stepped, but the log has the shape of a horizon
        log = log_of(self._problem, given, np.tile(controls, (self._problem.horizon, 1)))
        states = by_name(self._problem.states, given.state[None])
        found = self._interpreter.step(log, 0, states, losses=False).next_states
        self._known = {name: value[0] for name, value in found.items()}


def _of_shape(name: str, value: Array, shape: tuple[int, ...]) -> Array:
    if value.shape != shape:
        raise ValueError(f"`{name}` has shape {value.shape}, not {shape}")
    return value
