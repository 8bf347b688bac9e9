"""The `train` section, stages and their rollouts, and the `validate` section with its limits."""

from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import Field, ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.expressions.tree import Length
from spec_schema.fields.entry import Entry, Keyed, OneOf, RefusedError, findings_of
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.leaf import Located
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
    number,
    reads,
)
from spec_schema.fields.quantities import (
    POSITIVE_LENGTH,
    LengthField,
    PositiveLength,
    QuantityField,
    read_positive_length,
)
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.data import Source
from spec_schema.sections.optimizers import Optimizer
from spec_schema.yaml_tree.nodes import Node, Scalar, Table, kind

# 0 and 1 are both allowed: a rate that ends at 0, and one that stays
_Share = Annotated[float, number(least=0.0, most=1.0)]
# a rate of 0 would end training without a word, a factor above 1 would make it diverge
_Factor = Annotated[float, number(above=0.0, most=1.0)]


class Cosine(Entry):
    """The learning rate follows half a cosine, from its full value down to `to` times that after
    the last epoch.
    """

    noun: ClassVar[str] = "the cosine schedule"

    to: _Share = 0.0
    """Share of the rate that is left at the end."""


class Exponential(Entry):
    """The learning rate is multiplied by `factor` after each epoch."""

    noun: ClassVar[str] = "the exponential schedule"

    factor: _Factor = 0.99
    """What the rate is multiplied by."""


class Step(Entry):
    """The learning rate is multiplied by `factor` after every `every` epochs."""

    noun: ClassVar[str] = "the step schedule"

    every: PositiveCount
    """Epochs between two reductions."""
    factor: _Factor = 0.1
    """What the rate is multiplied by."""


class Plateau(Entry):
    """The learning rate is multiplied by `factor` after `patience` epochs without a better monitor,
    but never below `min` times its initial value.
    """

    noun: ClassVar[str] = "the plateau schedule"
    former: ClassVar[Mapping[str, str]] = MappingProxyType({"least": "min"})

    patience: PositiveCount = 10
    """Epochs without a better monitor."""
    factor: _Factor = 0.1
    """What the rate is multiplied by."""
    min: _Share = 0.0
    """Lower limit of the rate, as a share of its value at the start."""


class Schedule(OneOf):
    """The rule by which the learning rate of a stage decreases, epoch by epoch."""

    noun: ClassVar[str] = "schedule"

    cosine: Cosine | None = None
    """Half a cosine."""
    exponential: Exponential | None = None
    """The same factor after each epoch."""
    step: Step | None = None
    """A factor after each so many epochs."""
    plateau: Plateau | None = None
    """A factor when the monitor gets no better."""

    @property
    def choice(self) -> Cosine | Exponential | Step | Plateau:
        """The settings of the chosen schedule."""
        given = self.cosine or self.exponential or self.step or self.plateau
        assert given is not None
        return given


@dataclass(frozen=True)
class Lesson:
    """A step of a curriculum: up to the end of epoch `until`, rollouts have the length
    `horizon`.
    """

    until: int
    horizon: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Curriculum:
    """`{epoch: horizon, …}`: the lengths of rollouts up to the end of these epochs, in the order of
    the spec.
    """

    lessons: tuple[Lesson, ...]
    span: Span = field(compare=False)


def _read_curriculum(node: Node, findings: Findings) -> Curriculum:
    if not isinstance(node, Table) or not node.entries:
        found = "an empty mapping" if isinstance(node, Table) else kind(node)
        repair = "write for example `{20: 5, 40: 20}`: 5 samples up to epoch 20, then 20"
        findings.report(
            errors.wrong_kind("a mapping of epochs to horizons", found, node.span, repair)
        )
        raise RefusedError
    return Curriculum(
        tuple(
            Lesson(
                _epoch(name, node.keys[name], findings),
                read_positive_length(value, findings),
                node.keys[name],
            )
            for name, value in node.entries.items()
        ),
        node.span,
    )


def _epoch(text: str, span: Span, findings: Findings) -> int:
    # keys of a mapping are text; digits of other scripts are decimal to Python too
    if text.isascii() and text.isdecimal() and 0 < len(text) <= _DIGITS and int(text) > 0:
        return int(text)
    findings.report(errors.out_of_range(text[:40], span, "the number of an epoch, from 1"))
    raise RefusedError


# as many as every 32-bit number has; int() of longer texts may take its time
_DIGITS = 9

_CURRICULUM_SCHEMA = {
    "type": "object",
    "minProperties": 1,
    "propertyNames": {"pattern": "^[0-9]*[1-9][0-9]*$"},
    "additionalProperties": POSITIVE_LENGTH,
}
CurriculumField: TypeAlias = Annotated[Curriculum, reads(_read_curriculum, _CURRICULUM_SCHEMA)]


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
    """A simulation of `horizon` steps in which the inputs in `close` are fed back, by default all
    that an output predicts.

    Only steps from `skip` on are scored. `stride` is the distance between the start rows of two
    rollouts; its default depends on the section. `curriculum: {epoch: horizon}` trains on shorter
    rollouts up to these epochs.
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
    """Ends a stage after `patience` epochs without a better value of the loss `monitor`, by default
    the total.
    """

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


Metric: TypeAlias = Literal["rmse", "mae", "max_abs", "r2", "fit", "fvu", "aic"]
_ELSEWHERE = {"mse": "rmse", "max": "max_abs", "vaf": "r2", "nrmse": "fit", "bic": "aic"}
"""What others call metrics, or one of the same kind: the root of mse is in the output's unit."""


class Validation(Entry):
    """A metric of an output or a loss; `max` and `min` are its limits.

    It is measured on the set `data` of the data, or on other `files`, which have the layout of the
    section `data` by default.
    """

    noun: ClassVar[str] = "a validate entry"

    of: Reference
    """Output or loss."""
    metric: Annotated[Metric, choice(*get_args(Metric), elsewhere=_ELSEWHERE)] = "rmse"
    """How the deviation becomes a number."""
    target: ExpressionField | None = None
    """Logged sample it is compared with; by default that of `predicts`."""
    rollout: Rollout | None = None
    """How far predictions are fed back; one step by default."""
    skip_rows: LengthField | None = None
    """First rows of each record that are not scored, wherever rollouts start."""
    data: Reference | None = None
    """Set of the data; `test` by default."""
    files: Source | None = None
    """Other files to measure on, in place of a set of the data."""
    max: QuantityField | None = None
    """Limit that the metric must not exceed."""
    min: QuantityField | None = None
    """Limit that the metric must reach."""

    @model_validator(mode="after")
    def _has_one_set(self, info: ValidationInfo) -> "Validation":
        if self.data is not None and self.files is not None:
            place = self.files.place.key
            findings_of(info).report(errors.excluded_key("files", "data", place, self.noun))
        return self
