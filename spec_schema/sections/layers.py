"""A declared layer: one of the kinds, or a sum of cells of one kind; the fuzzy sets of a value."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, OneOf, RefusedError, findings_of, late_entries
from spec_schema.fields.formulas import ArrayField, ExpressionField
from spec_schema.fields.leaf import REFERENCE, Located
from spec_schema.fields.plain import ManyOf, Reference, References, Switch, choice, reads, scalar
from spec_schema.late_dataclass import dataclass
from spec_schema.names import normalised
from spec_schema.registry import LAYERS, with_keys
from spec_schema.yaml_tree.nodes import Node, Scalar, Table

Membership: TypeAlias = Literal["triangular", "rectangular", "gaussian"]


@dataclass(frozen=True)
class CustomMembership:
    """`{function: f}`: the degree of membership is f of the distance of the value to the centre."""

    function: Located[str]


def _read_membership(node: Node, findings: Findings) -> Membership | CustomMembership:
    match node:
        case Table(entries={"function": Scalar() as function}) if len(node.entries) == 1:
            return CustomMembership(Located(normalised(function.text), function.span))
        case Table():
            repair = f"write {', '.join(_SHAPES)} or `{{function: NAME}}`"
            # the key: the braces of a mapping underlined would be all of it
            place = node.key or node.span
            findings.report(errors.wrong_kind("a membership", "another mapping", place, repair))
            raise RefusedError
        case _:
            found = scalar(node, findings, f"one of {', '.join(_SHAPES)}").text
            # a loop, for the type: each word is the literal that it is compared with
            for word in _SHAPES:
                if word == found:
                    return word
            findings.report(errors.unknown_choice(found[:60], node.span, _SHAPES))
            raise RefusedError


_SHAPES: tuple[Membership, ...] = get_args(Membership)
_MEMBERSHIP = {
    "type": ["string", "object"],
    "pattern": f"^({'|'.join(_SHAPES)})$",
    "examples": list(_SHAPES),
    "properties": {"function": {"type": "string", "pattern": REFERENCE}},
    "required": ["function"],
    "additionalProperties": False,
}


class Fuzzify(Entry):
    """Degrees of membership of a value in fuzzy sets around `centers`, or a grid `over` others."""

    noun: ClassVar[str] = "a fuzzify layer"

    centers: ArrayField | None = None
    """Centres of the fuzzy sets, ascending."""
    membership: Annotated[Membership | CustomMembership, reads(_read_membership, _MEMBERSHIP)] = (
        "triangular"
    )
    """Shape of the sets, or `{function: NAME}`."""
    dim: Reference | None = None
    """Dimension that numbers the sets."""
    learn: Switch = False
    """Whether training moves the centres."""
    over: References = ()
    """Other fuzzify layers, of which this one is the grid."""
    combine: Annotated[Literal["product"], choice("product")] = "product"
    """How the degrees of a grid are combined."""

    @model_validator(mode="after")
    def _has_sets(self, info: ValidationInfo) -> "Fuzzify":
        findings = findings_of(info)
        if self.centers is None and not self.over:
            findings.report(errors.missing_key("centers", self.place.key, self.noun))
        # what is written, not what is there by default: a grid has its sets from other layers
        given = self.model_fields_set & {"centers", "membership", "dim", "learn"}
        for key in sorted(given) if self.over else ():
            findings.report(errors.excluded_key(key, "over", self.place.key, self.noun))
        return self


if TYPE_CHECKING:
    from spec_schema.sections.layer_kinds import (
        EquationLearner,
        Fir,
        Iir,
        Interpolation,
        Linear,
        Mlp,
        Normalize,
        SavitzkyGolay,
        StateSpace,
    )
else:
    Iir, SavitzkyGolay, StateSpace, EquationLearner, Fir, Linear, Mlp, Interpolation, Normalize = (
        late_entries(
            f"{__package__}.layer_kinds",
            "Iir",
            "SavitzkyGolay",
            "StateSpace",
            "EquationLearner",
            "Fir",
            "Linear",
            "Mlp",
            "Interpolation",
            "Normalize",
        )
    )


class Cell(OneOf):
    """The layer of which a local model has one copy for each fuzzy set."""

    noun: ClassVar[str] = "a cell"

    fir: Fir | None = None
    linear: Linear | None = None
    mlp: Mlp | None = None
    equation_learner: EquationLearner | None = None
    interpolation: Interpolation | None = None
    iir: Iir | None = None
    state_space: StateSpace | None = None


class LocalModel(Entry):
    """A sum of cells, one for each combination of fuzzy sets, each weighted by the product of their
    degrees of membership.
    """

    noun: ClassVar[str] = "a local_model layer"

    by: ManyOf[ExpressionField]
    """Degrees of membership that weigh the cells."""
    cell: Cell
    """The layer of each cell."""


@with_keys(LAYERS)
class Layer(OneOf):
    """A declared layer; exactly one kind is given."""

    noun: ClassVar[str] = "a layer"

    fir: Fir | None = None
    linear: Linear | None = None
    fuzzify: Fuzzify | None = None
    local_model: LocalModel | None = None
    mlp: Mlp | None = None
    equation_learner: EquationLearner | None = None
    interpolation: Interpolation | None = None
    normalize: Normalize | None = None
    iir: Iir | None = None
    state_space: StateSpace | None = None
    savitzky_golay: SavitzkyGolay | None = None
