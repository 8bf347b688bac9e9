"""Defines the values of a simulation of the reference interpreter: the beginning and all steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from enum import Enum
from typing import Any, Literal, TypeAlias, TypeVar

from numpy.typing import NDArray

from spec_schema.late_dataclass import dataclass
from spec_schema.registry import FixedPoint

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

FloatType: TypeAlias = Literal["float32", "float64"]
NumberType: TypeAlias = FloatType | FixedPoint
"""The number format of an export's computations."""


class Promise(Enum):
    """The accuracy that an export promises relative to the reference."""

    BITS = "the bits of the interpreter in the same arithmetic"
    ROUNDING = "each step as near to the interpreter in float64 as rounding allows"


@dataclass(frozen=True, slots=True)
class Beginning:
    """The known values at the first step of a simulation."""

    windows: Arrays
    """Samples for the initial states: one window per signal, (*shape)."""
    window_firsts: Mapping[str, int]
    """Index of the first sample in each window, relative to the first step."""
    states: Arrays
    """Initial states as the reference computes them, (*shape); some targets cannot compute all."""

    def window(self, signal: str, first: int, length: int) -> NDArray[Any]:
        """`length` samples of a signal from `first` on, (…, length); backends may need fewer
        samples.
        """
        # a backend may need fewer of the past than the judge's window has
        begin = first - self.window_firsts[signal]
        return self.windows[signal][..., begin : begin + length]


@dataclass(frozen=True, slots=True)
class Proof:
    """Reference values in fixed point, the same steps in real arithmetic, and a proven error bound.

    The steps in real arithmetic use inputs and states of the reference. Keys are names in messages;
    arrays are (steps, *shape), initial states (1, *shape).
    """

    values: Arrays
    exact: Arrays
    bounds: Mapping[str, float]
    """Proven error bounds; inf if nothing is proven."""
    steps: Mapping[str, int]
    """Number of steps from the recorded inputs; further steps follow them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Reference arrays (steps, *shape) by names of the spec; `states` are those before each step.

    A fixed-point reference has no `states`, because exports cannot set them.
    """

    beginning: Beginning
    inputs: Arrays
    states: Arrays
    outputs: Arrays
    next_states: Arrays
    restarted: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    """Masks (steps,) of steps after which a state was reset."""
    proof: Proof | None = None
    """Proven error bounds of the reference itself, for fixed point."""

    @property
    def steps(self) -> int:
        """The number of steps."""
        return len(next(iter(self.outputs.values())))


Judge: TypeAlias = Callable[[NumberType], Judgement]
"""Simulates the recorded inputs in a number format."""

V = TypeVar("V")


def labelled(outputs: Mapping[str, V], next_states: Mapping[str, V]) -> dict[str, V]:
    """Outputs and next states with their names in messages."""
    named = {f"`{name}`": values for name, values in outputs.items()}
    return named | {f"the state `{name}`": values for name, values in next_states.items()}


def labelled_first(states: Mapping[str, V]) -> dict[str, V]:
    """Initial states with their names in messages."""
    return {f"the first state `{name}`": values for name, values in states.items()}
