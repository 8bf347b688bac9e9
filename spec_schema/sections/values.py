"""The values a spec names: dimensions, constants, parameters, initial values, functions."""

from dataclasses import field, replace
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import knowledge
from spec_schema.errors import schema as errors
from spec_schema.errors import units as unit_errors
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry, OneOf, RefusedError, findings_of, single_key
from spec_schema.fields.formulas import ArrayField, ExpressionField
from spec_schema.fields.leaf import KeyAndValueSpan, Located
from spec_schema.fields.plain import (
    DifferentOf,
    LocatedText,
    NewName,
    NonNegativeNumber,
    Reference,
    References,
    Switch,
    Text,
    number,
    read_count,
    read_number,
    reads,
    scalar,
)
from spec_schema.fields.quantities import (
    QuantityField,
    UnitField,
    has_variance,
    read_unit,
    split_quantity,
)
from spec_schema.late_dataclass import dataclass
from spec_schema.units.parser import parse_unit
from spec_schema.units.quantity import Quantity, converted
from spec_schema.units.unit import UnitError
from spec_schema.yaml_tree.nodes import Listing, Node, Positions, Scalar, Table


@dataclass(frozen=True)
class Dimension:
    """The size of a dimension, and the labels of its elements; no labels if only the
    size is given.
    """

    size: int
    labels: tuple[str, ...]
    place: KeyAndValueSpan = field(compare=False)


def _read_dimension(node: Node, findings: Findings) -> Dimension:
    place = KeyAndValueSpan(node.key or node.span, node.span)
    if not isinstance(node, Listing):
        return Dimension(read_count(node, findings, least=1), (), place)
    labels: dict[str, Scalar] = {}
    for item in node.items:
        label = scalar(item, findings, "a label")
        # by their text: `1` and `01` are two labels
        first = labels.setdefault(label.text, label)
        if first is not label:
            findings.report(errors.repeated_item(label.text, label.span, first.span))
    if not labels:
        findings.report(errors.empty_section("a list of labels", node.span))
        raise RefusedError
    return Dimension(len(labels), tuple(labels), place)


_LABEL = {"type": ["string", "number", "boolean"]}
_DIMENSION_SCHEMA = {
    "type": ["integer", "array"],
    "minimum": 1,
    "items": _LABEL,
    "minItems": 1,
    "uniqueItems": True,
}
DimensionField: TypeAlias = Annotated[Dimension, reads(_read_dimension, _DIMENSION_SCHEMA)]


class NormalInitializer(Entry):
    """Draws from a normal distribution, in the unit of the parameter."""

    noun: ClassVar[str] = "a normal initialiser"

    mean: Annotated[float, number()] = 0.0
    """Mean of the distribution."""
    std: NonNegativeNumber = 1.0
    """Its standard deviation."""


class UniformInitializer(Entry):
    """Draws from a uniform distribution on [min, max], in the unit of the parameter."""

    noun: ClassVar[str] = "a uniform initialiser"

    min: Annotated[float, number()] = 0.0
    """Lowest number."""
    max: Annotated[float, number()] = 1.0
    """Highest number."""

    @model_validator(mode="after")
    def _is_ordered(self, info: ValidationInfo) -> "UniformInitializer":
        if self.min >= self.max:
            report = errors.reversed_range(f"{self.min:g}", f"{self.max:g}", self.place.value)
            findings_of(info).report(report)
        return self


class ExpInitializer(Entry):
    """`first` · e^(−`rate` · x): decreases along an axis, with x from 0 at its first element to 1
    at its last.
    """

    noun: ClassVar[str] = "an exp initialiser"

    first: Annotated[float, number()] = 1.0
    """First value."""
    rate: Annotated[float, number()] = 3.0
    """How often it falls by e from end to end."""
    along: Reference | None = None
    """Dimension along which the values change; by default the last axis."""


class NegexpInitializer(Entry):
    """`last` · e^(−`rate` · (1 − x)): increases along an axis, with x from 0 at its first element
    to 1 at its last, as the weights of newer samples do.
    """

    noun: ClassVar[str] = "a negexp initialiser"

    last: Annotated[float, number()] = 1.0
    """Last value."""
    rate: Annotated[float, number()] = 3.0
    """How often it falls by e from end to end."""
    along: Reference | None = None
    """Dimension along which the values change; by default the last axis."""


class LinInitializer(Entry):
    """A straight line from `first` to `last` along an axis."""

    noun: ClassVar[str] = "a lin initialiser"

    first: Annotated[float, number()] = 1.0
    """First value."""
    last: Annotated[float, number()] = 0.0
    """Last value."""
    along: Reference | None = None
    """Dimension along which the values change; by default the last axis."""


Shaped: TypeAlias = ExpInitializer | NegexpInitializer | LinInitializer
"""Initialisers whose values depend on the index along one axis, by default the last."""

InitialValue: TypeAlias = (
    Expression | NormalInitializer | UniformInitializer | Shaped | Located[str]
)
"""What `init:` can be; a text is the name of a file, relative to that of the spec."""


class Initializer(OneOf):
    """The initial values of an array; a lone expression is `value`.

    The expression may use the indices `i`, `j`, … of the array's axes, and the length `n` of the
    last one.
    """

    noun: ClassVar[str] = "an initial value"

    value: ArrayField | None = None
    """Numbers, or an expression of the indices i, j, … of the array."""
    normal: NormalInitializer | None = None
    uniform: UniformInitializer | None = None
    exp: ExpInitializer | None = None
    negexp: NegexpInitializer | None = None
    lin: LinInitializer | None = None
    file: LocatedText | None = None
    """File of numbers, relative to the spec."""

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        # `{linspace: [0, 1, 5]}` is an array as constants have it too, not one of the ways below
        is_variant = isinstance(node, Table) and "linspace" not in node.entries
        return super().canonical(node if is_variant else single_key(node, "value"), findings)

    @property
    def choice(self) -> InitialValue:
        """The settings of the form that is given; a text is the name of a file."""
        # `OneOf` has seen to it that exactly one is given, so the order of these does not matter
        random = self.normal or self.uniform
        given = self.value or random or self.exp or self.negexp or self.lin or self.file
        assert given is not None
        return given


class Constant(Entry):
    """A number or array that no training changes; it is computed when the spec is compiled."""

    noun: ClassVar[str] = "a constant"
    shorthand: ClassVar[str | None] = "value"

    value: ArrayField
    """The numbers, or an expression of them."""
    dims: References = ()
    unit: UnitField | None = None
    doc: Text | None = None

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        # the shorthand of an entry takes scalars and lists; this mapping is a value as well
        if isinstance(node, Table) and set(node.entries) == {"linspace"}:
            node = single_key(node, "value")
        return _with_split_unit(super().canonical(node, findings), "value", findings)


class Prior(Entry):
    """The normal distribution of a parameter's elements that is assumed before there are data."""

    noun: ClassVar[str] = "a prior"

    mean: QuantityField
    """Where it is expected."""
    std: QuantityField
    """How far from there it may well be: its standard deviation."""

    @model_validator(mode="after")
    def _is_spread(self, info: ValidationInfo) -> "Prior":
        if self.std.value <= 0:
            findings_of(info).report(knowledge.narrow_prior(self.std.text, self.std.span))
        else:
            # a deviation may be positive while its square is 0 or infinite in float64
            has_variance(self.std, findings_of(info))
        return self


OfData: TypeAlias = Literal["data"]


def _read_scale(node: Node, findings: Findings) -> float | OfData:
    # by its text: in quotes or not it is the same word
    if isinstance(node, Scalar) and node.text == "data":
        return "data"
    value = read_number(node, findings)
    # raw variables are divided by it
    if value <= 0:
        findings.report(errors.out_of_range(f"{value:g}", node.span, "above 0, or `data`"))
        raise RefusedError
    return value


_SCALE = {
    "type": ["number", "string"],
    "exclusiveMinimum": 0,
    "pattern": "^data$",
    "examples": ["data"],
}


class Parameter(Entry):
    """A value that training can learn; the optimiser works with the value divided by `scale`."""

    noun: ClassVar[str] = "a parameter"
    shorthand: ClassVar[str | None] = "init"

    init: Initializer
    """Value before training: numbers, an expression, or how they are drawn."""
    min: QuantityField | None = None
    """Bound that training never goes below."""
    max: QuantityField | None = None
    """Bound that training never goes above."""
    unit: UnitField | None = None
    dims: References = ()
    scale: Annotated[float | OfData, reads(_read_scale, _SCALE)] | None = None
    """Typical size, or `data`; the optimiser works on the value divided by it."""
    learn: Switch = True
    """Whether training changes it."""
    prior: Prior | None = None
    """What is known of it before the data."""
    doc: Text | None = None

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        return _with_split_unit(super().canonical(node, findings), "init", findings)

    @model_validator(mode="after")
    def _prior_is_learned(self, info: ValidationInfo) -> "Parameter":
        if self.prior is not None and not self.learn:
            findings_of(info).report(knowledge.prior_of_a_constant(self.prior.place.key))
        return self


def _with_split_unit(node: Node, key: str, findings: Findings) -> Node:
    """The entry with a quantity split into number and unit: `{init: 5 N/m}` becomes `{init: 5,
    unit: N/m}`, and `{init: 300 K, unit: degC}` a number in degC. `key` is the key of the quantity.
    """
    value = node.entries.get(key) if isinstance(node, Table) else None
    parts = split_quantity(value) if isinstance(value, Scalar) else None
    # what is no entry or no quantity is reported where its field reads it
    if not isinstance(node, Table) or parts is None:
        return node
    amount, unit = parts
    declared = node.entries.get("unit")
    if isinstance(declared, Scalar) and declared.text.strip() != unit.text:
        # goes on with the declared one, so that a mistake is told once and not of each use
        amount = _converted_amount(amount, unit, declared, findings)
        unit = declared
    entries = {**node.entries, key: amount, "unit": unit}
    # a key that is written keeps its place
    keys = {"unit": unit.span, **node.keys}
    return Table(entries, keys, node.span, node.key)


def _converted_amount(amount: Scalar, unit: Scalar, declared: Scalar, findings: Findings) -> Scalar:
    """The number `amount` in `unit`, converted to the `declared` unit. Units that do not convert
    are reported; the number is then unchanged.
    """
    try:
        wanted = parse_unit(declared.text)
    except UnitError:
        return amount  # which the field `unit` reports
    try:
        own = read_unit(unit, findings).value
    except RefusedError:
        return amount
    if not own.converts_to(wanted):
        report = unit_errors.two_units(unit.text, declared.text, unit.span, declared.span)
        findings.report(report)
        return amount
    quantity = Quantity(float(amount.text), own, amount.span.to(unit.span))
    number = converted(quantity, wanted, findings)
    if number is None or number == quantity.value:
        return amount
    text = repr(number)
    # each digit of the new number stands where the old one does
    old = amount.positions
    places = Positions(old.source, [old.offsets[0]] * len(text) + [old.offsets[-1]])
    return replace(amount, text=text, value=text, positions=places)


Arguments: TypeAlias = DifferentOf[NewName]


class Function(Entry):
    """A named formula; the compiler inserts it at each call."""

    noun: ClassVar[str] = "a function"

    args: Arguments
    """Names of the arguments."""
    expr: ExpressionField
    """The formula."""
    doc: Text | None = None
