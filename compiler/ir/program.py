"""Defines the typed intermediate representation: a synchronous stream program in SSA form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from enum import Enum
from typing import Literal

from compiler.ir.fit import Fit
from compiler.ir.graph import Graph as Graph
from compiler.ir.graph import Node as Node
from compiler.ir.graph import NodeId as NodeId
from compiler.ir.training.known import Penalty, Prior, Statistic
from compiler.ir.types import Axis, Prediction, Type
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit
from spec_schema.version import __version__

InvalidPolicy = Literal["clamp", "hold", "flag", "trust"]
RangePolicy = Literal["flag", "saturate", "reset"]


class Role(Enum):
    """The reason why a signal is in the log."""

    INPUT = "input"
    """Read by the step: part of the deployed interface."""
    TARGET = "target"
    """Read by losses and metrics only."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A logged quantity: an input, or a target that only training reads."""

    name: str
    role: Role
    axes: tuple[Axis, ...] = ()
    unit: Unit | None = None
    range: tuple[float, float] | None = None
    on_invalid: InvalidPolicy = "flag"
    doc: str = ""
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A learnable array: initial value in C order, bounds and unit are physical.

    The optimiser works on a raw variable: physical = scale·raw without bounds, a sigmoid between
    two bounds, a softplus above or below one; one mechanism for all optimisers.
    """

    name: str
    axes: tuple[Axis, ...] = ()
    unit: Unit | None = None
    initial: tuple[float, ...] = (0.0,)
    minimum: float | None = None
    maximum: float | None = None
    scale: float = 1.0
    """What the raw variable of a value is a multiple of."""
    learn: bool = True
    statistic: Statistic | None = None
    """Where the value comes from if not from `initial`, which is only where nothing is known."""
    prior: Prior | None = None
    """In its unit."""
    scales_by_data: bool = False
    """Whether training takes the scale from its data."""
    doc: str = ""
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Declared:
    """A state that the spec declares under `states:`."""


@dataclass(frozen=True, slots=True)
class LayerMemory:
    """The memory of a layer, of a call such as `integral`, or of the count of a warm-up."""

    starts_fresh_each_run: bool = False
    """Whether it starts alike wherever a run begins, as that there was no step before."""


@dataclass(frozen=True, slots=True)
class History:
    """A buffer of the last samples of a signal or value, made by the compiler."""

    source: str
    """What is buffered: an input or a named equation."""


@dataclass(frozen=True, slots=True)
class Tape:
    """The values of a closed signal up to `ahead−1` samples after t, made by closing a loop."""

    signal: str
    ahead: int


Origin = Declared | LayerMemory | History | Tape


@dataclass(frozen=True, slots=True)
class State:
    """Memory between steps; a buffer (History, Tape) has the window as its last axis."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    origin: Origin
    next: NodeId
    """Node of `Program.step` whose value the state takes after the step."""
    start: NodeId
    """Node of `Program.start` whose value the state has before the first step."""
    range: tuple[float, float] | None = None
    doc: str = ""
    span: Span | None = field(default=None, compare=False)
    on_range: RangePolicy = "flag"
    """What becomes of a next value outside `range`. Where it is `saturate`, `next` keeps to the
    range by itself; `reset` is for deployed code alone."""
    needs: tuple[str, ...] = ()
    """Sub-models that the `next:` of a discrete state needs in the same step."""
    fit_over: int | None = None
    """The first evaluations of each run that decide by least squares where the state starts, from
    `start` on, 0 for the whole run; None where `start` does."""

    @property
    def is_buffer(self) -> bool:
        """Whether it holds samples, which a `Window` shifts by one in each step."""
        return Type(self.axes).window is not None


@dataclass(frozen=True, slots=True)
class Output:
    """A named result of the step."""

    name: str
    node: NodeId
    predicts: Prediction | None = None
    doc: str = ""
    span: Span | None = field(default=None, compare=False)
    needs: tuple[str, ...] = ()
    """Sub-models that it needs in the same step."""


@dataclass(frozen=True, slots=True)
class Expected:
    """The values that the spec expects of an equation; nothing is computed for it alone.

    An equation of which the step computes several samples (`e`, `e[t-3]`) has one for each node.
    """

    name: str
    node: NodeId
    range: tuple[float, float]
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Formula:
    """The spec's own text for a value, to be read beside generated code: `travel` = `w - z`."""

    left: str
    """A name, `der(x)` or `next(x)`."""
    right: str
    span: Span = field(compare=False)


class Measure(Enum):
    """The measure that makes a loss a number: a mean over steps, starts, window and dims."""

    MSE = "mse"
    """… (prediction − target)²."""
    RMSE = "rmse"
    """… (prediction − target)², then its root per batch."""
    MAE = "mae"
    """… |prediction − target|."""
    HUBER = "huber"
    """… e²/2 for |e| ≤ δ, δ (|e| − δ/2) beyond, e = prediction − target (Huber 1964)."""
    MEAN = "mean"
    """… the prediction itself: an expression that is already a cost."""


@dataclass(frozen=True, slots=True)
class Loss:
    """One term of the training objective, weight · share · measure.

    Elements whose target is NaN are not scored, nor rows whose factor is 0. The terms of an entry
    that is a sum of measures are named `entry.mse` and so on.
    """

    name: str
    measure: Measure
    prediction: NodeId
    target: NodeId | None
    weight: float = 1.0
    """Of the entry; a stage can replace it."""
    share: float = 1.0
    """The factor of this term in the entry's sum."""
    penalty: Penalty | None = None
    span: Span | None = field(default=None, compare=False)
    rows: NodeId | None = None
    """How much each row counts in the mean, a number ≥ 0 of the log alone; None for 1."""
    delta: float = 1.0
    """δ of `huber`, in the unit of its difference; other measures have none."""
    is_default: bool = False
    """Whether nobody wrote it: that of an output which predicts, where there are no `losses:`."""

    @property
    def measured(self) -> str:
        """The measure in words, with its δ where that is not the default."""
        delta = "" if self.delta == 1.0 else f", delta {self.delta:g}"
        return f"{self.measure.value}{delta}"

    @property
    def nodes(self) -> tuple[NodeId, ...]:
        """All values of the step that it needs."""
        others = (node for node in (self.target, self.rows) if node is not None)
        return (self.prediction, *others)

    def moved(self, copies: Mapping[NodeId, NodeId]) -> Loss:
        """The loss in a graph in which `copies` tells where its nodes are."""
        return replace(
            self,
            prediction=copies[self.prediction],
            target=None if self.target is None else copies[self.target],
            rows=None if self.rows is None else copies[self.rows],
        )

    @property
    def entry(self) -> str:
        """The name under `losses:`, or of the output whose default loss this is."""
        # no name that can have a loss has a dot: losses of sub-models stay behind (R11)
        return self.name.partition(".")[0]


@dataclass(frozen=True, slots=True)
class Dimension:
    """A named dimension of the spec and the labels of its elements, empty where it has none."""

    name: str
    size: int
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UsedPlugin:
    """A plug-in that brings something that the spec uses."""

    package: str
    version: str


def with_plugins(plugins: Sequence[UsedPlugin]) -> str:
    """` with msnn-example 0.1.0`; empty without plug-ins."""
    named = ", ".join(f"{plugin.package} {plugin.version}" for plugin in plugins)
    return f" with {named}" if named else ""


@dataclass(frozen=True, slots=True)
class Program:
    """A model as a pure function of logs, states and parameters: `step` at every t, `start` at t0.

    *Window form*: `ReadSignal` nodes read any samples of the inputs. *Step form* (`to_step_form`):
    they read sample t, a preview [t … t+n] or one delayed sample, and buffers hold the past.
    """

    name: str
    sample_time: float | None
    """Seconds between samples; None for a static model whose rows are independent samples."""
    signals: tuple[Signal, ...]
    parameters: tuple[Parameter, ...]
    states: tuple[State, ...]
    step: Graph
    start: Graph
    outputs: tuple[Output, ...]
    losses: tuple[Loss, ...] = ()
    expected: tuple[Expected, ...] = ()
    """Ranges of equations that outputs, states or losses need."""
    fits: tuple[Fit, ...] = ()
    """Layers that training starts by least squares; while there are losses."""
    dimensions: tuple[Dimension, ...] = ()
    formulas: tuple[Formula, ...] = ()
    """Of equations, outputs and states, for people."""
    doc: str = ""
    spec_hash: str = ""
    """sha256 of the spec's text, so that weights and generated files can name their source."""
    plugins: tuple[UsedPlugin, ...] = ()
    """The plug-ins without which the spec cannot be read."""
    late: int = 0
    """Samples by which a step form lags: its step at t is that of the model at t-late."""

    @property
    def made_by(self) -> str:
        """The version of msnn, and of the plug-ins of the spec, for files made of the program."""
        return f"msnn {__version__}{with_plugins(self.plugins)}"

    def signal(self, name: str) -> Signal:
        return next(signal for signal in self.signals if signal.name == name)

    def parameter(self, name: str) -> Parameter:
        return next(parameter for parameter in self.parameters if parameter.name == name)

    def state(self, name: str) -> State:
        return next(state for state in self.states if state.name == name)

    def output(self, name: str) -> Output:
        return next(output for output in self.outputs if output.name == name)

    def expected_range(self, name: str) -> tuple[float, float] | None:
        """The range of an equation, which may be an output; None without one."""
        return next((entry.range for entry in self.expected if entry.name == name), None)
