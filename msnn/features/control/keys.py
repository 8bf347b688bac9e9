"""The keys of the sections `mpc` and `estimator`, and of `export: {mpc: …}`."""

from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import Field, ValidationInfo, model_validator

from msnn.features.control.errors import control as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as schema_errors
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import (
    BySignal,
    Entry,
    Named,
    OneOf,
    RefusedError,
    SomeBySignal,
    findings_of,
)
from spec_schema.fields.formulas import EXPRESSION, ExpressionField, read_expression
from spec_schema.fields.leaf import Gathering, JsonSchema, Located, one_or_many
from spec_schema.fields.plain import (
    DifferentOf,
    ManyOf,
    NewName,
    NonNegativeNumber,
    PositiveCount,
    PositiveNumber,
    Reference,
    References,
    Switch,
    Text,
    choice,
    read_count,
    read_different_items,
    reads,
)
from spec_schema.fields.quantities import (
    LARGEST_DEVIATION,
    QUANTITY,
    SMALLEST_DEVIATION,
    PositiveLength,
    QuantityField,
    UnitField,
    has_variance,
    read_quantity,
    split_quantity,
)
from spec_schema.sections.exports import FloatTargetEntry, UnitPlatform
from spec_schema.units.quantity import Quantity
from spec_schema.yaml_tree.nodes import Node, Scalar

Hessian: TypeAlias = Literal["exact", "gauss_newton"]
Structure: TypeAlias = Literal["auto", "staged", "condensed"]
Mode: TypeAlias = Literal["converged", "fixed"]


def _read_limit(node: Node, findings: Findings) -> Quantity | Expression:
    """A number, a quantity such as `2 mm`, or else an expression of references. Mistakes are
    reported, then RefusedError is raised.
    """
    # a number with or without a unit; anything else is an expression of references
    if isinstance(node, Scalar) and (
        split_quantity(node) is not None or type(node.value) in (int, float)
    ):
        return read_quantity(node, findings)
    return read_expression(node, findings)


LimitField: TypeAlias = Annotated[Quantity | Expression, reads(_read_limit, EXPRESSION)]


def _read_rate(node: Node, findings: Findings) -> Quantity:
    rate = read_quantity(node, findings)
    if rate.value <= 0:
        findings.report(schema_errors.out_of_range(rate.text, rate.span, "above 0"))
        raise RefusedError
    return rate


# located, as a wrong sum of blocks is reported at the last of them
def _read_block(node: Node, findings: Findings) -> Located[int]:
    return Located(read_count(node, findings, 1), node.span, node.key)


_BLOCK = {"type": "integer", "minimum": 1}


def _read_controls(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    items = read_different_items(node, info)
    if not items:
        findings_of(info).report(schema_errors.empty_section("`controls`", node.span))
        raise RefusedError
    return items


def _some(item: JsonSchema) -> JsonSchema:
    return {**one_or_many(item), "minItems": 1}


Controls: TypeAlias = Annotated[tuple[Reference, ...], Gathering(_read_controls, schema=_some)]


class ControlCost(Entry):
    """The sum that the controller minimises: `stage` over the horizon, plus `terminal`."""

    noun: ClassVar[str] = "the cost"
    shorthand: ClassVar[str | None] = "stage"

    stage: ExpressionField
    """Cost of each sample t … t+N-1, a number without unit."""
    terminal: ExpressionField | None = None
    """Cost of the state at t+N, a number without unit."""


class SoftBound(Entry):
    """The cost of violating a bound, per unit of the bounded value; by default it follows from the
    cost.

    A `linear` part above the multiplier of the bound makes the penalty exact: the bound holds
    wherever that is possible.
    """

    noun: ClassVar[str] = "a soft bound"

    linear: PositiveNumber | None = None
    """Cost of a violation by one unit."""
    quadratic: NonNegativeNumber | None = None
    """Cost of the square of a violation by one unit."""


class ControlBound(Entry):
    """Limits of a control, state, output or equation along the horizon.

    Limits of controls, and their `rate`, always hold. All others are soft unless `hard: true`.
    """

    noun: ClassVar[str] = "a bound"

    min: LimitField | None = None
    """Lowest value: a number, a quantity, or an expression of references."""
    max: LimitField | None = None
    """Highest value: a number, a quantity, or an expression of references."""
    rate: Annotated[Quantity, reads(_read_rate, {**QUANTITY, "exclusiveMinimum": 0})] | None = None
    """Largest change of a control per second."""
    soft: SoftBound | None = None
    """The cost of a violation."""
    hard: Switch = False
    """True if no plan may violate it."""

    @model_validator(mode="after")
    def _says_one_thing(self, info: ValidationInfo) -> "ControlBound":
        findings = findings_of(info)
        # such a bound is most likely a slip of indentation
        if self.min is None and self.max is None and self.rate is None:
            findings.report(errors.bound_of_nothing(self.place.key))
        # a violation that may not be has no price
        if self.hard and self.soft is not None:
            findings.report(errors.soft_and_hard(self.soft.place.key))
        return self


class ControlReference(Entry):
    """An external value for cost and bounds, given to the controller with each measurement."""

    noun: ClassVar[str] = "a reference"
    shorthand: ClassVar[str | None] = "unit"

    unit: UnitField | None = None
    dims: References = ()
    preview: Switch = False
    """True if its values at t … t+N are given, not only the one at t."""
    doc: Text | None = None


class InteriorPoint(Entry):
    """A primal-dual interior-point method with exact second derivatives of the problem."""

    noun: ClassVar[str] = "the interior_point solver"

    structure: Annotated[Structure, choice("auto", "staged", "condensed")] = "auto"
    """Stage by stage (`staged`), in the controls alone (`condensed`), or the cheaper of both."""
    mode: Annotated[Mode, choice("converged", "fixed")] = "converged"
    """Iterate until the tolerance is reached, or always a fixed number of iterations."""
    iterations: PositiveCount | None = None
    """Maximum iterations per try, 50 by default; `converged` may try twice. 5 if `fixed`."""
    tolerance: PositiveNumber | None = None
    """Largest residual of the optimality conditions that counts as solved; 1e-6 by default."""


class ControlSolver(OneOf):
    """The method that solves the problem."""

    noun: ClassVar[str] = "solver"

    interior_point: InteriorPoint | None = None


class OptimalControl(Entry):
    """The optimal control problem of a predictive controller, whose plant is the trained model."""

    noun: ClassVar[str] = "mpc"

    horizon: PositiveLength
    """Length of the prediction horizon: samples or a time."""
    controls: Controls
    """Inputs that the controller sets."""
    cost: ControlCost
    """The cost that the controller minimises."""
    bounds: BySignal[ControlBound] = Field(default_factory=dict[str, ControlBound])
    """Limits, by the names of controls, states, outputs and equations."""
    references: Named[ControlReference] = Field(default_factory=dict[str, ControlReference])
    """External values for cost and bounds, given with each measurement."""
    preview: References = ()
    """Inputs whose next N samples are known; others are assumed constant from t on."""
    blocks: ManyOf[Annotated[Located[int], reads(_read_block, _BLOCK)]] = ()
    """Numbers of samples over which controls stay constant, one per block; 1 by default."""
    hessian: Annotated[Hessian, choice("exact", "gauss_newton")] = "exact"
    """Second derivatives of cost, plant and bounds (`exact`), or of the cost alone."""
    solver: ControlSolver | None = None
    """How the problem is solved."""

    @property
    def interior_point(self) -> InteriorPoint | None:
        """The settings of the solver, None for the defaults."""
        return None if self.solver is None else self.solver.interior_point


def _read_positive(node: Node, findings: Findings) -> Quantity:
    quantity = read_quantity(node, findings)
    if quantity.value <= 0:
        findings.report(schema_errors.out_of_range(quantity.text, quantity.span, "above 0"))
        raise RefusedError
    if not has_variance(quantity, findings):
        raise RefusedError
    return quantity


def _read_not_negative(node: Node, findings: Findings) -> Quantity:
    quantity = read_quantity(node, findings)
    if quantity.value < 0:
        findings.report(schema_errors.out_of_range(quantity.text, quantity.span, "at least 0"))
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
        """The settings of the chosen estimator."""
        # `OneOf` has seen to it that exactly one is given
        chosen = self.ekf or self.mhe
        assert chosen is not None
        return chosen


OnlineExtra: TypeAlias = Literal["fmu"]


class MpcExport(FloatTargetEntry):
    """The controller of the section `mpc` and the filter of the section `estimator`, of those that
    the spec has.

    Names start with `prefix`, by default the spec's name. The sections define the controlled,
    measured and fed-back signals, so the keys `outputs` and `close` are not allowed here. `with:
    fmu` adds units for co-simulation.
    """

    noun: ClassVar[str] = "the mpc export"

    prefix: NewName | None = None
    extras: DifferentOf[Annotated[OnlineExtra, choice("fmu")]] = Field(default=(), alias="with")
    """What is generated beside the C: units of FMI 2.0 and 3.0."""
    platforms: DifferentOf[Annotated[UnitPlatform, choice(*get_args(UnitPlatform))]] = ()
    """Kinds of machines to compile the units for as well, by zig."""
