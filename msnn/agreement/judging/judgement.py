"""Holds what runs along a record give: where they begin, and every step of the judge."""

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
"""What an export computes in."""


class Promise(Enum):
    """The promise of an export about its judge's values along a record."""

    BITS = "the bits of the interpreter in the same arithmetic"
    ROUNDING = "each step as near to the interpreter in float64 as rounding allows"


@dataclass(frozen=True, slots=True)
class Beginning:
    """The known values at the first step of a run."""

    windows: Arrays
    """What the first states are made of: one window a signal, (*shape)."""
    window_firsts: Mapping[str, int]
    """The first sample in each of them, counted from the first step."""
    states: Arrays
    """The first states as the judge makes them, (*shape): some targets cannot compute all."""

    def window(self, signal: str, first: int, length: int) -> NDArray[Any]:
        """As many samples of a signal from `first` on, (…, length): some backends need fewer."""
        # a backend may need fewer of the past than the judge's window has
        begin = first - self.window_firsts[signal]
        return self.windows[signal][..., begin : begin + length]


@dataclass(frozen=True, slots=True)
class Proof:
    """The judge's values, those of the same steps in real numbers, and a bound of the error.

    The steps in real numbers begin with the inputs and states of the judge's. All go by the names
    that messages give them; arrays are (steps, *shape), first states (1, *shape).
    """

    values: Arrays
    exact: Arrays
    bounds: Mapping[str, float]
    """inf where nothing is proved."""
    steps: Mapping[str, int]
    """How many are of the record; others stand behind them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Arrays (steps, *shape) by the names of the spec; `states` are those before each step.

    A judge whose states cannot be set in exports, as that of fixed point, shows none.
    """

    beginning: Beginning
    inputs: Arrays
    states: Arrays
    outputs: Arrays
    next_states: Arrays
    restarted: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    """After which steps a state began again, (steps,) each."""
    proof: Proof | None = None
    """Where the judge is off by no more than is proved, if it is as the model means."""

    @property
    def steps(self) -> int:
        """The number of steps."""
        return len(next(iter(self.outputs.values())))


Judge: TypeAlias = Callable[[NumberType], Judgement]
"""A free run along the record in an arithmetic."""

V = TypeVar("V")


def labelled(outputs: Mapping[str, V], next_states: Mapping[str, V]) -> dict[str, V]:
    """Outputs and next states under the names that messages give them."""
    named = {f"`{name}`": values for name, values in outputs.items()}
    return named | {f"the state `{name}`": values for name, values in next_states.items()}


def labelled_first(states: Mapping[str, V]) -> dict[str, V]:
    """States before the first step, likewise."""
    return {f"the first state `{name}`": values for name, values in states.items()}
