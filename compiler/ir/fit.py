"""Describes the layers whose weights training initialises by least squares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

from compiler.ir.graph import Graph
from compiler.ir.types import Axis, Prediction, Type
from spec_schema.late_dataclass import dataclass

FilterKind: TypeAlias = Literal["iir", "state_space"]


@dataclass(frozen=True, slots=True)
class Fit:
    """A filter layer that is initialised as the linear system fitted from its argument to a target.

    The fit is least squares over the training rows.
    """

    kind: FilterKind
    layer: str
    argument: Graph
    """Computes the argument of the layer; its last node is the value. It reads inputs and
    parameters only."""
    target: Prediction
    """The signal, and its time offset, that the output of the filter is fitted to."""
    num: int
    """Order of the numerator."""
    den: int
    """Order of the denominator."""
    feedthrough: bool
    """True if the argument affects the result in the same step."""
    radius: float
    """Maximum magnitude of the poles."""

    @property
    def array_names(self) -> tuple[str, ...]:
        """The parameter arrays of the layer that the fit sets."""
        return filter_arrays(self.kind, self.feedthrough)

    def sizes(self, target: tuple[Axis, ...]) -> Mapping[str, int]:
        """The number of elements of each array, for a target with these axes."""
        outputs = Type(target).size
        match self.kind:
            case "iir":
                return {"num": outputs * (self.num + 1), "reflection": outputs * self.den}
            case "state_space":
                inputs = self.argument.nodes[-1].type.size
                direct = {"D": outputs * inputs} if self.feedthrough else {}
                sizes = {"B": self.den * inputs, "C": outputs * self.den, "reflection": self.den}
                return {**sizes, **direct}


def filter_arrays(kind: FilterKind, feedthrough: bool) -> tuple[str, ...]:
    """The names of the parameter arrays of a filter layer."""
    match kind:
        case "iir":
            return ("num", "reflection")
        case "state_space":
            return ("B", "C", "reflection", *(("D",) if feedthrough else ()))
