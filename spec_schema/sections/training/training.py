"""The `train` section: stages and rollouts; the rollout is used by `validate` too."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.tree import Length
from spec_schema.fields.entry import Entry
from spec_schema.fields.located import Located
from spec_schema.fields.named_tables import Keyed
from spec_schema.fields.plain import (
    Dtype,
    LocatedText,
    ManyOf,
    NewName,
    NonNegativeCount,
    NonNegativeNumber,
    PositiveCount,
    PositiveNumber,
    Reference,
    References,
    Switch,
    Weight,
    choice,
    reads,
)
from spec_schema.fields.quantities import (
    POSITIVE_LENGTH,
    LengthField,
    PositiveLength,
    read_positive_length,
)
from spec_schema.sections.training.curriculum import CurriculumField
from spec_schema.sections.training.optimizers import Optimizer
from spec_schema.sections.training.schedules import Schedule
from spec_schema.yaml_tree.nodes import Node, Scalar, Table

Whole: TypeAlias = Literal["episode", "record"]
_HORIZON = {
    **POSITIVE_LENGTH,
    "pattern": f"{POSITIVE_LENGTH['pattern']}|^(episode|record)$",
    "examples": ["episode", "record"],
}
_WHOLE: dict[str, Whole] = {"episode": "episode", "record": "record"}


def _read_horizon(node: Node, findings: Findings) -> Length | Whole:
    # words first: a length would read `record` as an unknown unit
    if isinstance(node, Scalar) and node.text in _WHOLE:
        return _WHOLE[node.text]
    return read_positive_length(node, findings)


class Rollout(Entry):
    """A run over `horizon` evaluations; the inputs in `close` are fed back, () means all that can.

    Scores count from evaluation `skip` on. `stride` is the distance of starts; None is the default
    of the section. `curriculum: {epoch: horizon}` trains on shorter rollouts up to those epochs.
    """

    noun: ClassVar[str] = "rollout"
    shorthand: ClassVar[str | None] = "horizon"

    horizon: Annotated[Length | Whole, reads(_read_horizon, _HORIZON)]
    """Steps or duration of a run, `episode` or `record`."""
    stride: PositiveLength | None = None
    """Distance of the starts."""
    skip: LengthField | None = None
    """First part that is not scored."""
    warm_up: LengthField | None = None
    """First part in which closed signals are read from the log; it is not scored."""
    close: References | None = None
    """Inputs that are fed back; all that can be by default."""
    curriculum: CurriculumField | None = None
    """Shorter horizons, each up to the end of an epoch."""

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        node = super().canonical(node, findings)
        close = node.entries.get("close") if isinstance(node, Table) else None
        # `close: all` is what no `close:` means; further on there is one form
        if isinstance(node, Table) and isinstance(close, Scalar) and close.text == "all":
            entries = {key: value for key, value in node.entries.items() if key != "close"}
            return Table(entries, node.keys, node.span, node.key)
        return node


class EarlyStop(Entry):
    """Ends a stage after `patience` epochs without a better `monitor` (default: total loss)."""

    noun: ClassVar[str] = "early_stop"

    monitor: Reference | None = None
    """Loss that is watched; the total by default."""
    patience: PositiveCount = 10
    """Epochs without a better value."""


EngineName: TypeAlias = Annotated[
    Literal["auto", "native", "torch"], choice("auto", "native", "torch")
]


class Stage(Entry):
    """One stage of training; each starts from the best weights of the one before."""

    noun: ClassVar[str] = "a training stage"

    name: NewName | None = None
    """Name of the stage in reports."""
    epochs: PositiveCount = 100
    """Most passes over the data."""
    batch: PositiveCount = 128
    """Rollouts a step."""
    optimizer: Optimizer
    """The optimiser; `adam` by default."""
    losses: Keyed[Weight] = Field(default_factory=dict[str, Located[float]])
    """Weights of losses in this stage."""
    freeze: ManyOf[LocatedText] = ()
    """Parameters that keep their values; `*` stands for any text."""
    lr: Keyed[Weight] = Field(default_factory=dict[str, Located[float]])
    """Factors of the step length of single parameters."""
    schedule: Schedule | None = None
    """How the learning rate goes down."""
    clip: PositiveNumber | None = None
    """Longest gradient."""
    rollout: Rollout | None = None
    """How far predictions are fed back; one step by default."""
    skip_rows: LengthField | None = None
    """First rows of each record that are not scored, wherever rollouts start."""
    early_stop: EarlyStop | None = None
    """When to end before all epochs."""
    seed: NonNegativeCount = 0
    """Seed of the shuffling."""
    # half the memory and twice the lanes of float64: the noise of batches is far above rounding
    dtype: Dtype = "float32"
    """Precision of the arithmetic."""
    engine: EngineName = "auto"
    """What computes: native kernels or torch."""
    threads: PositiveCount = 1
    """Threads of the native engine; any number gives the same bits."""
    reproducible: Switch = False
    """Insists on kernels with the same bits on every processor."""
    starts: PositiveCount = 1
    """Runs from different initial values, of which the best goes on."""
    weight_decay: NonNegativeNumber = 0.0
    """Pull of the weights towards 0."""

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        node = super().canonical(node, findings)
        # a stage that names no optimizer has Adam; its place is that of the stage
        if not isinstance(node, Table) or "optimizer" in node.entries:
            return node
        key = node.key or node.span
        adam = Table({}, {}, key, key)
        optimizer = Table({"adam": adam}, {"adam": key}, key, key)
        # its key has no place: a message about it points at the stage
        return Table({**node.entries, "optimizer": optimizer}, node.keys, node.span, node.key)
