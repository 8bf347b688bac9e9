"""The `estimator` section: estimation of states and parameters while the model runs."""

from typing import Annotated, ClassVar, TypeAlias

from pydantic import Field

from msnn.features.control.keys.mpc import ControlSolver
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import BySignal, Entry, OneOf, RefusedError, SomeBySignal
from spec_schema.fields.plain import reads
from spec_schema.fields.quantities import (
    LARGEST_DEVIATION,
    QUANTITY,
    SMALLEST_DEVIATION,
    PositiveLength,
    QuantityField,
    has_variance,
    read_quantity,
)
from spec_schema.units.quantity import Quantity
from spec_schema.yaml_tree.nodes import Node


def _read_positive(node: Node, findings: Findings) -> Quantity:
    quantity = read_quantity(node, findings)
    if quantity.value <= 0:
        findings.report(errors.out_of_range(quantity.text, quantity.span, "above 0"))
        raise RefusedError
    if not has_variance(quantity, findings):
        raise RefusedError
    return quantity


def _read_not_negative(node: Node, findings: Findings) -> Quantity:
    quantity = read_quantity(node, findings)
    if quantity.value < 0:
        findings.report(errors.out_of_range(quantity.text, quantity.span, "at least 0"))
        raise RefusedError
    # 0 says "no drift"; any other must not become 0 when it is squared
    if quantity.value and not has_variance(quantity, findings):
        raise RefusedError
    return quantity


_POSITIVE = {**QUANTITY, "minimum": SMALLEST_DEVIATION, "maximum": LARGEST_DEVIATION}
_NOT_NEGATIVE = {**QUANTITY, "minimum": 0, "maximum": LARGEST_DEVIATION}
Deviation: TypeAlias = Annotated[Quantity, reads(_read_positive, _POSITIVE)]
"""A standard deviation."""
Drift: TypeAlias = Annotated[Quantity, reads(_read_not_negative, _NOT_NEGATIVE)]
"""A standard deviation that may be 0."""


class EstimatedParameter(Entry):
    """A parameter that is estimated together with the states, as a constant or a slow drift."""

    noun: ClassVar[str] = "an estimated parameter"

    std: Deviation
    """Standard deviation of the first estimate, which is the trained value."""
    # None is 0: a parameter that does not move at all, whose variance only shrinks
    walk: Drift | None = None
    """Standard deviation of its random drift in one second; 0 by default."""
    min: QuantityField | None = None
    """Lower limit of the estimate."""
    max: QuantityField | None = None
    """Upper limit of the estimate."""


class KalmanFilter(Entry):
    """An extended Kalman filter: each sample predicts by the model and corrects by measurements."""

    noun: ClassVar[str] = "the ekf estimator"

    measured: SomeBySignal[Deviation]
    """Outputs with `predicts`, and the standard deviation of their measurement noise."""
    # per second, so that a change of the sample time leaves the spec as it is
    process: BySignal[Drift] = Field(default_factory=dict[str, Quantity])
    """Standard deviation of each state's process noise in one second."""
    initial: BySignal[Drift] = Field(default_factory=dict[str, Quantity])
    """Standard deviation of each initial state; states that are not listed are known exactly."""
    parameters: BySignal[EstimatedParameter] = Field(default_factory=dict[str, EstimatedParameter])
    """Parameters that are estimated too."""


class MovingHorizon(KalmanFilter):
    """Moving-horizon estimation: the best fit of the states to the measurements of a window.

    Bounds of parameters always hold, and ranges of states wherever they can.
    """

    noun: ClassVar[str] = "the mhe estimator"

    horizon: PositiveLength
    """Length of the window: samples or a time."""
    solver: ControlSolver | None = None
    """How the problem is solved: stage by stage."""


class Estimator(OneOf):
    """An estimator of states that are not measured."""

    noun: ClassVar[str] = "estimator"

    ekf: KalmanFilter | None = None
    mhe: MovingHorizon | None = None

    @property
    def choice(self) -> KalmanFilter | MovingHorizon:
        """The one that is given."""
        # `OneOf` has seen to it that exactly one is given
        chosen = self.ekf or self.mhe
        assert chosen is not None
        return chosen
