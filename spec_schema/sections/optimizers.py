"""The optimisers of a training stage and their options."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, Keyed, OneOf, RefusedError
from spec_schema.fields.leaf import Located
from spec_schema.fields.plain import (
    LocatedText,
    PositiveCount,
    PositiveNumber,
    number,
    read_number,
    reads,
    scalar,
)
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, kind

# 1 itself is a mean that never forgets: Adam divides by 1 − βᵗ, and momentum would grow for ever
_BelowOne = Annotated[float, number(least=0.0, below=1.0)]

FromSearch: TypeAlias = Literal["auto"]


def _read_rate(node: Node, findings: Findings) -> float | FromSearch:
    # by its text: in quotes or not it is the same word
    if isinstance(node, Scalar) and node.text == "auto":
        return "auto"
    value = read_number(node, findings)
    if value <= 0:
        findings.report(errors.out_of_range(f"{value:g}", node.span, "above 0, or `auto`"))
        raise RefusedError
    return value


_RATE = {
    "type": ["number", "string"],
    "exclusiveMinimum": 0,
    "pattern": "^auto$",
    "examples": ["auto"],
}
_Rate = Annotated[float | FromSearch, reads(_read_rate, _RATE)]


class OptimizerOptions(Entry):
    """The settings of an optimiser in a spec, and properties of the class that a spec cannot
    change.
    """

    # facts of the class, not fields: a user cannot set them, and the schema for editors leaves them
    # out
    steps_by: ClassVar[Literal["kernel", "torch", "LAPACK"]] = "kernel"
    """Whose arithmetic makes a step of the slopes that a kernel or torch has found."""
    takes_all_starts: ClassVar[bool] = False
    """Whether each step takes all starts, unless a stage gives its `batch`."""
    takes_factors: ClassVar[bool] = True
    """Whether single parameters can have steps of another length."""
    reaches_corners: ClassVar[bool] = True
    """Whether its steps can end exactly where a penalty has a corner: at 0 (decision 0215)."""
    needs_squares: ClassVar[bool] = False
    """Whether it takes the residuals of losses that are sums of squares, in float64."""


class Adam(OptimizerOptions):
    """Adam (Kingma, Ba 2015); `weight_decay` of the stage is added to the gradient."""

    noun: ClassVar[str] = "the adam optimizer"

    lr: _Rate = 1e-3
    """Step length of the optimiser; `auto` tries many before the first epoch."""
    # defaults of the paper and of torch.optim, so that a spec behaves as people expect of the name
    beta1: _BelowOne = 0.9
    """Decay of the mean."""
    beta2: _BelowOne = 0.999
    """Decay of the square."""
    eps: PositiveNumber = 1e-8
    """Least divisor."""


class AdamW(OptimizerOptions):
    """Adam with decoupled weight decay (Loshchilov, Hutter 2019)."""

    noun: ClassVar[str] = "the adamw optimizer"

    lr: _Rate = 1e-3
    """Step length of the optimiser; `auto` tries many before the first epoch."""
    beta1: _BelowOne = 0.9
    """Decay of the mean."""
    beta2: _BelowOne = 0.999
    """Decay of the square."""
    eps: PositiveNumber = 1e-8
    """Least divisor."""


class Sgd(OptimizerOptions):
    """Stochastic gradient descent with momentum."""

    noun: ClassVar[str] = "the sgd optimizer"

    lr: _Rate = 1e-2
    """Step length of the optimiser; `auto` tries many before the first epoch."""
    momentum: _BelowOne = 0.0
    """How much of the last step is kept."""


class Lbfgs(OptimizerOptions):
    """Limited-memory BFGS with a strong-Wolfe line search (Nocedal, Wright 2006)."""

    noun: ClassVar[str] = "the lbfgs optimizer"
    takes_all_starts = True
    takes_factors = False
    reaches_corners = False

    # no `auto`: the line search finds the length of each step, 1 being the whole quasi-Newton step
    lr: PositiveNumber = 1.0
    """Step length of the optimiser."""
    history: PositiveCount = 10
    """Steps from which the curvature is estimated."""
    iterations: PositiveCount = 20
    """Most steps an epoch; it ends sooner after 1.25 times as many looks at the losses."""


OptionValue: TypeAlias = bool | int | float | str | tuple[bool | int | float | str | None, ...]


def _read_option(node: Node, findings: Findings) -> Located[OptionValue]:
    if isinstance(node, Listing):
        items = tuple(_read_item(item, findings) for item in node.items)
        return Located(items, node.span, node.key)
    found = scalar(node, findings, "a number, a word, a switch or a list of those")
    assert found.value is not None
    return Located(found.value, found.span, found.key)


def _read_item(node: Node, findings: Findings) -> bool | int | float | str | None:
    if isinstance(node, Scalar):
        # `null` is an argument of some classes of torch: within a list None passes
        return node.value
    findings.report(errors.wrong_kind("a number", kind(node), node.span))
    raise RefusedError


_ALONE = ["number", "boolean", "string"]
_OPTION = {"type": [*_ALONE, "array"], "items": {"type": [*_ALONE, "null"]}}
_Option = Annotated[Located[OptionValue], reads(_read_option, _OPTION)]


class TorchOptimizer(OptimizerOptions):
    """An optimiser of `torch.optim` by the name of its class, with `options` as arguments of that
    class.
    """

    noun: ClassVar[str] = "the torch optimizer"
    shorthand: ClassVar[str | None] = "name"
    steps_by = "torch"
    reaches_corners = False

    name: LocatedText
    """Class of torch.optim, such as `RAdam`."""
    options: Keyed[_Option] = Field(default_factory=dict[str, Located[OptionValue]])
    """Arguments of the class."""


class LevenbergMarquardt(OptimizerOptions):
    """Levenberg-Marquardt for sums of squares (Marquardt 1963), in float64.

    Each epoch is one step computed from all rollouts. `damping` is that of the first step, relative
    to the curvature in each parameter. The stage ends when a step changes the total loss by less
    than the fraction `tolerance`.
    """

    noun: ClassVar[str] = "the levenberg_marquardt optimizer"
    steps_by = "LAPACK"
    takes_all_starts = True
    needs_squares = True

    damping: PositiveNumber = 1e-3
    """Of the first step, relative to the curvature in each parameter."""
    tolerance: PositiveNumber = 1e-9
    """Relative change of the total at which the stage ends."""


OptimizerChoice: TypeAlias = Adam | AdamW | Sgd | Lbfgs | TorchOptimizer | LevenbergMarquardt


class Optimizer(OneOf):
    """The optimiser of a stage."""

    noun: ClassVar[str] = "optimizer"

    adam: Adam | None = None
    adamw: AdamW | None = None
    sgd: Sgd | None = None
    lbfgs: Lbfgs | None = None
    torch: TorchOptimizer | None = None
    levenberg_marquardt: LevenbergMarquardt | None = None

    @property
    def choice(self) -> OptimizerChoice:
        """The settings of the chosen optimiser."""
        first_order = self.adam or self.adamw or self.sgd or self.torch
        given = first_order or self.lbfgs or self.levenberg_marquardt
        assert given is not None
        return given
