"""A declared layer: one of the kinds, or a sum of cells of one kind."""

from typing import TYPE_CHECKING, ClassVar

from spec_schema.fields.entry import Entry, OneOf
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.late_entry import late_entries
from spec_schema.fields.plain import ManyOf
from spec_schema.registry import LAYERS, with_keys
from spec_schema.sections.layers.fuzzy_sets import Fuzzify

if TYPE_CHECKING:
    from spec_schema.sections.layers.filters import Iir, SavitzkyGolay, StateSpace
    from spec_schema.sections.layers.networks import EquationLearner, Fir, Linear, Mlp
    from spec_schema.sections.layers.tables import Interpolation, Normalize
else:
    Iir, SavitzkyGolay, StateSpace = late_entries(
        f"{__package__}.filters", "Iir", "SavitzkyGolay", "StateSpace"
    )
    EquationLearner, Fir, Linear, Mlp = late_entries(
        f"{__package__}.networks", "EquationLearner", "Fir", "Linear", "Mlp"
    )
    Interpolation, Normalize = late_entries(f"{__package__}.tables", "Interpolation", "Normalize")


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
    """A sum of cells, each weighted by the product of its activations."""

    noun: ClassVar[str] = "a local_model layer"

    by: ManyOf[ExpressionField]
    """Degrees of membership that weigh the cells."""
    cell: Cell
    """The layer of each cell."""


@with_keys(LAYERS)
class Layer(OneOf):
    """A declared layer."""

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
