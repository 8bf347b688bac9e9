"""Says what a stepper asks of whatever computes its steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, TypeAlias

from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]

StepsBy: TypeAlias = Literal["c", "interpreter"]
"""The compiled C of the export, or the interpreter in the arithmetic of that C."""


class StepEngine(Protocol):
    """One instance of a model. `inputs` and `outputs` are arrays of ctypes, field after field."""

    inputs: Any
    outputs: Any

    @property
    def name(self) -> StepsBy:
        """The name of what computes."""
        ...

    @property
    def step(self) -> Callable[[], int]:
        """Computes outputs of the inputs, and the states of the next step; status bits."""
        ...

    @property
    def waiting(self) -> int:
        """BUFFERS_EMPTY and STATES_UNSET, as far as they hold."""
        ...

    def init(self) -> None:
        """Sets the states that need no data."""
        ...

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states, from samples around the first step; status bits."""
        ...

    def states(self) -> dict[str, Array]:
        """The values of all states."""
        ...

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states."""
        ...

    def no_longer_waits(self, bits: int) -> None:
        """Takes bits away from `waiting`."""
        ...
