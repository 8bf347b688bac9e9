"""The layers a spec can declare."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from spec_schema.entry import Entry, Variant
from spec_schema.expression_fields import ArrayField, ExpressionField
from spec_schema.plain_fields import ManyOf, Reference, Switch, choice
from spec_schema.quantity_fields import PositiveLength
from spec_schema.values import Initializer

Membership: TypeAlias = Literal["triangular", "rectangular", "gaussian"]


class Fir(Entry):
    """A finite impulse response over a window; without `window` its argument is one."""

    noun: ClassVar[str] = "a fir layer"
    later: ClassVar[frozenset[str]] = frozenset({"dropout"})

    window: PositiveLength | None = None
    out: Reference | None = None
    bias: Switch = False
    init: Initializer | None = None


class Linear(Entry):
    """An affine map of the last dim of its argument."""

    noun: ClassVar[str] = "a linear layer"
    later: ClassVar[frozenset[str]] = frozenset({"dropout"})

    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None


class Fuzzify(Entry):
    """Degrees of membership of a value in fuzzy sets around `centers`."""

    noun: ClassVar[str] = "a fuzzify layer"
    later: ClassVar[frozenset[str]] = frozenset({"over", "combine"})

    centers: ArrayField
    membership: Annotated[
        Membership, choice("triangular", "rectangular", "gaussian", later=("function",))
    ] = "triangular"
    dim: Reference | None = None
    learn: Switch = False


class Cell(Variant):
    """The layer of which a local model has one copy for each fuzzy set."""

    noun: ClassVar[str] = "a cell"

    fir: Fir | None = None
    linear: Linear | None = None

    @property
    def choice(self) -> Fir | Linear:
        """The one that is given."""
        given = self.fir or self.linear
        assert given is not None
        return given


class LocalModel(Entry):
    """A sum of cells, each weighted by the product of its activations."""

    noun: ClassVar[str] = "a local_model layer"

    by: ManyOf[ExpressionField]
    cell: Cell


class Layer(Variant):
    """A declared layer."""

    noun: ClassVar[str] = "a layer"
    later: ClassVar[frozenset[str]] = frozenset(
        {"iir", "state_space", "equation_learner", "interpolation", "mlp", "normalize"}
    )

    fir: Fir | None = None
    linear: Linear | None = None
    fuzzify: Fuzzify | None = None
    local_model: LocalModel | None = None

    @property
    def choice(self) -> Fir | Linear | Fuzzify | LocalModel:
        """The one that is given."""
        given = self.fir or self.linear or self.fuzzify or self.local_model
        assert given is not None
        return given
