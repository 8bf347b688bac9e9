"""Records in a program what training fits by least squares before it begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from compiler.ir.types import Prediction

FilterKind: TypeAlias = Literal["iir", "state_space"]


@dataclass(frozen=True, slots=True)
class Fit:
    """A layer that starts at the filter of its input nearest to a target's training rows."""

    kind: FilterKind
    layer: str
    input: str
    target: Prediction
    """What the input leads to."""
    num: int
    """Order of the numerator."""
    den: int
    """Order of the denominator."""
    feedthrough: bool
    """Whether the input reaches the result in the same step."""
    radius: float
    """Largest magnitude of the poles."""

    @property
    def arrays(self) -> dict[str, int]:
        """The arrays of the layer that it sets, and how many elements each has."""
        return filter_arrays(self.kind, self.num, self.den, self.feedthrough)


def filter_arrays(kind: FilterKind, num: int, den: int, feedthrough: bool) -> dict[str, int]:
    """The arrays of a filter layer from one scalar to another, and how many elements each has."""
    match kind:
        case "iir":
            return {"num": num + 1, "reflection": den}
        case "state_space":
            direct = {"D": 1} if feedthrough else {}
            return {"B": den, "C": den, "reflection": den, **direct}
