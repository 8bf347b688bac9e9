"""Runs compiled floating-point C: simulation, single steps and Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.c.host.library import CStep
from backends.c.interface.interface import Interface
from msnn.agreement.judging.judgement import Arrays, Beginning
from msnn.agreement.loaded import ExportedSlopes, Loaded, stacked


def loaded_c(step: CStep, interface: Interface) -> Loaded:
    """Uses one instance of the C code; with Jacobian if the export has one."""
    model = _CModel(step, interface)
    matrices = interface.jacobian
    slopes = None if matrices is None else ExportedSlopes(matrices.jacobian, model.slopes)
    return Loaded(model.run, model.start, model.step_each, lambda: slopes)


@dataclass(frozen=True, slots=True)
class _CModel:
    step: CStep
    interface: Interface

    def start(self, beginning: Beginning) -> Arrays:
        """The initial states that `reset` computes from the samples around the first step."""
        windows = {
            field.name: beginning.window(
                field.name, port.first, port.last - port.first + 1
            ).reshape(field.shape)
            for field, port in self.interface.windows
        }
        supplied = {
            field.name: beginning.states[state.name] for field, state in self.interface.supplied
        }
        # what the log says of buffers, and values of states that only a caller knows
        self.step.reset(windows | supplied)
        return {name: value[np.newaxis] for name, value in self.step.states().items()}

    def run(self, beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        """Simulates with the loop in C."""
        self.start(beginning)
        return self.step.run(inputs, steps)[0]

    def step_each(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            self.step.set_states({name: values[k] for name, values in states.items()})
            found, _ = self.step.step({name: values[k] for name, values in inputs.items()})
            outputs.append(found)
            following.append(self.step.states())
        return stacked(outputs), stacked(following)

    def slopes(self, inputs: Arrays, states: Arrays, steps: int) -> Arrays:
        found: list[Arrays] = []
        for k in range(steps):
            self.step.set_states({name: values[k] for name, values in states.items()})
            slopes, _ = self.step.linearize({name: values[k] for name, values in inputs.items()})
            found.append(slopes)
        return stacked(found)
