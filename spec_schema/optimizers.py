"""The optimisers of a training stage and their options."""

from typing import Annotated, ClassVar

from spec_schema.entry import Entry, Variant
from spec_schema.plain_fields import PositiveCount, PositiveNumber, number

_BelowOne = Annotated[float, number(least=0.0, most=1.0)]


class Adam(Entry):
    """Adam (Kingma, Ba 2015); `weight_decay` of the stage is added to the gradient."""

    noun: ClassVar[str] = "the adam optimizer"

    lr: PositiveNumber = 1e-3
    beta1: _BelowOne = 0.9
    beta2: _BelowOne = 0.999
    eps: PositiveNumber = 1e-8


class AdamW(Entry):
    """Adam with decoupled weight decay (Loshchilov, Hutter 2019)."""

    noun: ClassVar[str] = "the adamw optimizer"

    lr: PositiveNumber = 1e-3
    beta1: _BelowOne = 0.9
    beta2: _BelowOne = 0.999
    eps: PositiveNumber = 1e-8


class Sgd(Entry):
    """Stochastic gradient descent with momentum."""

    noun: ClassVar[str] = "the sgd optimizer"

    lr: PositiveNumber = 1e-2
    momentum: _BelowOne = 0.0


class Lbfgs(Entry):
    """Limited-memory BFGS with a strong-Wolfe line search."""

    noun: ClassVar[str] = "the lbfgs optimizer"

    lr: PositiveNumber = 1.0
    history: PositiveCount = 10
    iterations: PositiveCount = 20


class Optimizer(Variant):
    """The optimiser of a stage."""

    noun: ClassVar[str] = "optimizer"
    later: ClassVar[frozenset[str]] = frozenset({"levenberg_marquardt"})

    adam: Adam | None = None
    adamw: AdamW | None = None
    sgd: Sgd | None = None
    lbfgs: Lbfgs | None = None

    @property
    def choice(self) -> Adam | AdamW | Sgd | Lbfgs:
        """The one that is given."""
        given = self.adam or self.adamw or self.sgd or self.lbfgs
        assert given is not None
        return given
