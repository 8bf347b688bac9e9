"""Builds a `torch.nn.Module` of a step-form program: (inputs, state) → (outputs, state)."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from backends.ports.step_interface import Port, step_interface
from backends.torch_module.module import FloatArray, Windows, build_module
from compiler.ir.program import Program


class StepModule(nn.Module):
    """One step of a model in step form as a torch module in this process. It is used like an
    exported one:

        state = module.initial_state(windows)
        outputs, state = module(inputs, state)

    The first axis of every tensor is the batch; a window has its oldest sample first. Values are
    physical, in the units of the spec. Learned parameters are `parameters()`, in a form that keeps
    them within their bounds; `weights()` returns their physical values.
    """

    def __init__(self, program: Program, dtype: torch.dtype, device: str = "cpu") -> None:
        super().__init__()
        self.model = build_module(program, dtype, device)
        interface = step_interface(program)
        self._inputs = {port.signal.name: port for port in interface.inputs}
        self._windows = {port.signal.name: port for port in interface.start_windows}

    def forward(
        self, inputs: Mapping[str, Tensor], state: Mapping[str, Tensor]
    ) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """The outputs of this step and the next state, from the inputs and the state; all by name,
        (B, *shape). Raises KeyError for a missing one.
        """
        batch = self._batch({**inputs, **state})
        found = self.model.step_on(_cut(inputs, self._inputs), state, self.model.frame(), batch)
        return found.outputs, found.next_states

    def initial_state(self, windows: Mapping[str, Tensor] | None = None) -> dict[str, Tensor]:
        """The state before the first step by name, from recorded samples around it. `windows` has
        (B, *shape), or (B, *shape, samples), by name of signal; None if the start reads none.
        Raises KeyError for a missing one.
        """
        windows = windows or {}
        frame, batch = self.model.frame(), self._batch(windows)
        return self.model.start_on(_cut(windows, self._windows), frame, batch)

    def weights(self) -> dict[str, FloatArray]:
        """The physical values of all parameters by name, as float64 arrays."""
        return self.model.weights()

    @staticmethod
    def _batch(given: Mapping[str, Tensor]) -> int:
        return next((len(tensor) for tensor in given.values()), 1)


def _cut(given: Mapping[str, Tensor], ports: Mapping[str, Port]) -> Windows:
    """A function that reads samples of `given`, tensors by name: (signal, first, last) → (B,
    *shape, last−first+1). A tensor has a time axis only if its port has several samples.
    """

    def windows(signal: str, first: int, last: int) -> Tensor:
        port, value = ports[signal], given[signal]
        if len(port.type.shape) == len(port.signal.axes):  # a single sample, without that axis
            value = value[..., None]
        return value[..., first - port.first : last - port.first + 1]

    return windows
