"""Records in a program what training fits by least squares before it begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

from compiler.ir.graph import Graph
from compiler.ir.types import Axis, Prediction, Type
from spec_schema.late_dataclass import dataclass

FilterKind: TypeAlias = Literal["iir", "state_space"]


@dataclass(frozen=True, slots=True)
class Fit:
    """A layer that starts at the linear system of its argument nearest to a target's rows."""

    kind: FilterKind
    layer: str
    argument: Graph
    """Its last node is what the layer is called with, of inputs and parameters alone."""
    target: Prediction
    """What the argument leads to."""
    num: int
    """Order of the numerator."""
    den: int
    """Order of the denominator."""
    feedthrough: bool
    """Whether the argument reaches the result in the same step."""
    radius: float
    """Largest magnitude of the poles."""

    @property
    def array_names(self) -> tuple[str, ...]:
        """The arrays of the layer that it sets."""
        return filter_arrays(self.kind, self.feedthrough)

    def sizes(self, target: tuple[Axis, ...]) -> Mapping[str, int]:
        """The elements of each array, for a target with these axes."""
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
    """The arrays of a filter layer."""
    match kind:
        case "iir":
            return ("num", "reflection")
        case "state_space":
            return ("B", "C", "reflection", *(("D",) if feedthrough else ()))
