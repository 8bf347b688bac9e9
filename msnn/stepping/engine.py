"""Defines the interface of step engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, TypeAlias

from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]

StepsBy: TypeAlias = Literal["c", "interpreter"]
"""The compiled C code of the export, or the interpreter in the same arithmetic."""


class StepEngine(Protocol):
    """One instance of a model; `inputs` and `outputs` are ctypes arrays, field after field."""

    inputs: Any
    outputs: Any

    @property
    def name(self) -> StepsBy:
        """The name of the engine."""
        ...

    @property
    def step(self) -> Callable[[], int]:
        """Computes outputs from the inputs, and the next states; returns status bits."""
        ...

    @property
    def waiting(self) -> int:
        """The bits BUFFERS_EMPTY and STATES_UNSET, if they apply."""
        ...

    def init(self) -> None:
        """Sets the states that need no data."""
        ...

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states from samples around the first step; returns status bits."""
        ...

    def states(self) -> dict[str, Array]:
        """The values of all states."""
        ...

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states."""
        ...

    def no_longer_waits(self, bits: int) -> None:
        """Clears bits of `waiting`."""
        ...
