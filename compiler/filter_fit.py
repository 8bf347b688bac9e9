"""What training fits by least squares before it begins, as a program says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Fit:
    """A layer that starts at the filter of its input nearest to a target's training rows."""

    kind: Literal["iir", "state_space"]
    layer: str
    input: str
    target: str
    ahead: int
    """How many samples later the target is that the input leads to."""
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
        match self.kind:
            case "iir":
                return {"num": self.num + 1, "reflection": self.den}
            case "state_space":
                direct = {"D": 1} if self.feedthrough else {}
                return {"B": self.den, "C": self.den, "reflection": self.den, **direct}
