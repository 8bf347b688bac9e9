"""The layer `dead_zone`: 0 within a learned width around 0, and linear outside."""

from typing import ClassVar

from msnn.extending import (
    Arguments,
    Entry,
    LayerContext,
    LayerRule,
    NodeId,
    NonNegativeNumber,
    read_value,
)


class DeadZone(Entry):
    """A dead zone, such as that of a valve."""

    noun: ClassVar[str] = "a dead_zone layer"
    width: NonNegativeNumber = 0.0
    """The initial half width, in the unit of the argument."""


def dead_zone(context: LayerContext, settings: DeadZone, arguments: Arguments) -> NodeId:
    """y = max(x - w, 0) + min(x + w, 0), with one learned w >= 0 in the unit of x."""
    (x,) = arguments
    builder = context.builder
    unit = builder.type(x).unit
    w = context.learned("width", (), settings.width, "half width", unit=unit, low=0.0)
    zero = builder.constant(0.0)
    above = builder.maximum(zero, builder.subtract(x, w))
    return builder.add(above, builder.minimum(zero, builder.add(x, w)))


DEAD_ZONE = LayerRule(DeadZone, read_value, dead_zone)
