"""Defines the intermediate representation: a typed synchronous stream program in SSA form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from enum import Enum
from typing import Literal, TypeAlias

from compiler.ir.ops import Broadcast, Op
from compiler.ir.types import Axis, Prediction, Type
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit
from spec_schema.version import __version__


@dataclass(frozen=True, slots=True)
class Prior:
    """A Gaussian prior of a parameter: mean and standard deviation, the same for each element."""

    mean: float
    std: float


@dataclass(frozen=True, slots=True)
class Penalty:
    """A penalty on the parameter `parameter`, not differentiable where elements or slices are 0.

    Proximal optimisers handle it apart from the other losses (decision 0215). They use its value,
    but not its derivative.
    """

    parameter: str
    over: str | None
    """The axis whose slices are penalised by their norms; None penalises the magnitude of each
    element."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """The mean or standard deviation of a signal over the training rows; it initialises a
    parameter.
    """

    kind: Literal["mean", "std"]
    signal: str


NodeId = int
"""Index of a node in its graph; operands have smaller indices than the nodes that use them."""


@dataclass(frozen=True, slots=True)
class Node:
    """One operation of a graph: the ids of its operands, the static type of its value and its place
    in the spec.
    """

    op: Op
    args: tuple[NodeId, ...]
    type: Type
    # equal operations are one node, also if the spec repeats them: it has the place of the first
    span: Span | None = field(default=None, compare=False)
    label: str | None = field(default=None, compare=False)
    """Name of the equation, output or layer with this value, for comments and reports."""


@dataclass(frozen=True, slots=True)
class Graph:
    """A list of nodes, operands first; the index of a node in it is its node id."""

    nodes: tuple[Node, ...] = ()

    def __getitem__(self, node: NodeId) -> Node:
        return self.nodes[node]

    def __len__(self) -> int:
        return len(self.nodes)

    def __iter__(self) -> Iterator[tuple[NodeId, Node]]:
        return iter(enumerate(self.nodes))

    def unrepeated(self, node: NodeId) -> NodeId:
        """The node id of the value before it was repeated: follows operands through `Broadcast`
        nodes. Returns `node` itself if it is no `Broadcast`.
        """
        while isinstance(self.nodes[node].op, Broadcast):
            (node,) = self.nodes[node].args
        return node


FilterKind: TypeAlias = Literal["iir", "state_space"]


@dataclass(frozen=True, slots=True)
class Fit:
    """A filter layer whose initial parameters are fitted to the data before training.

    The fit is the linear system that maps the layer's `argument` to the signal `target` with the
    least squared error over the training rows.
    """

    kind: FilterKind
    layer: str
    argument: Graph
    """Computes the argument of the layer; its last node is the value. It reads inputs and
    parameters only."""
    target: Prediction
    """The signal, and its time offset, that the output of the filter is fitted to."""
    num: int
    """Order of the numerator."""
    den: int
    """Order of the denominator."""
    feedthrough: bool
    """True if the argument affects the result in the same step."""
    radius: float
    """Maximum magnitude of the poles."""

    @property
    def array_names(self) -> tuple[str, ...]:
        """The names of the layer's parameter arrays that the fit sets, without the name of the
        layer.
        """
        return filter_arrays(self.kind, self.feedthrough)

    def sizes(self, target: tuple[Axis, ...]) -> Mapping[str, int]:
        """The number of elements of each parameter array of the layer, by its name. `target` are
        the axes of the target signal.
        """
        outputs = Type(target).size
        match self.kind:
            case "iir":
                return {"num": outputs * (self.num + 1), "reflection": outputs * self.den}
            case "state_space":
                inputs = self.argument.nodes[-1].type.size
                direct = {"D": outputs * inputs} if self.feedthrough else {}
                sizes = {"B": self.den * inputs, "C": outputs * self.den, "reflection": self.den}
                return {**sizes, **direct}


def filter_arrays(kind: FilterKind, feedthrough: bool) -> tuple[str, ...]:
    """The names of the parameter arrays of a filter layer of this kind; `D` exists only if the
    argument affects the result in the same step (`feedthrough`).
    """
    match kind:
        case "iir":
            return ("num", "reflection")
        case "state_space":
            return ("B", "C", "reflection", *(("D",) if feedthrough else ()))


InvalidPolicy = Literal["clamp", "hold", "flag", "trust"]
RangePolicy = Literal["flag", "saturate", "reset"]


class Role(Enum):
    """The use of a recorded signal: the model reads an input; only losses and validation read a
    target.
    """

    INPUT = "input"
    """The step reads it; it is an input of the deployed model."""
    TARGET = "target"
    """Only losses and metrics read it."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A recorded quantity: an input, or a target that only losses and validation read. `range` are
    its declared limits, `on_invalid` is the reaction of deployed code to invalid values.
    """

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
    """A learnable array. Initial value (C order), bounds and unit are physical.

    First-order optimisers work on an unconstrained raw variable. Without bounds physical =
    scale·raw; a sigmoid maps it between two bounds, a softplus above or below one.
    Levenberg-Marquardt steps in physical values within the bounds.
    """

    name: str
    axes: tuple[Axis, ...] = ()
    unit: Unit | None = None
    initial: tuple[float, ...] = (0.0,)
    minimum: float | None = None
    maximum: float | None = None
    scale: float = 1.0
    """Unit of the raw variable: physical = scale·raw for a parameter without bounds."""
    learn: bool = True
    statistic: Statistic | None = None
    """The statistic of the data that training initialises it with. `initial` is its value
    without data."""
    prior: Prior | None = None
    """Gaussian prior, in the unit of the parameter."""
    scales_by_data: bool = False
    """True if training computes the scale from its data."""
    doc: str = ""
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Declared:
    """Origin of a state that the spec declares under `states:`."""


@dataclass(frozen=True, slots=True)
class LayerMemory:
    """Origin of a state that a layer, a call such as `integral`, or the count of warm-up steps
    needs.
    """

    starts_fresh_each_run: bool = False
    """True for memory that means "no step has run yet"; every run initialises it the same way."""


@dataclass(frozen=True, slots=True)
class History:
    """Origin of a buffer of past samples of an input or an equation, added by the compiler."""

    source: str
    """The name of the buffered input or equation."""


@dataclass(frozen=True, slots=True)
class Tape:
    """Origin of a buffer that `close_loop` adds for an input that a closed loop replaces. It holds
    the samples up to t+ahead−1 of the signal.
    """

    signal: str
    ahead: int


Origin = Declared | LayerMemory | History | Tape


@dataclass(frozen=True, slots=True)
class State:
    """Memory between steps. A buffer (History, Tape) has the window as its last axis."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    origin: Origin
    next: NodeId
    """Node of `Program.step`: the value of the state after the step."""
    start: NodeId
    """Node of `Program.start`: the value of the state before the first step."""
    range: tuple[float, float] | None = None
    doc: str = ""
    span: Span | None = field(default=None, compare=False)
    on_range: RangePolicy = "flag"
    """The action when the next value leaves `range`. With `saturate`, the node `next` is already
    limited; `reset` exists in deployed code only."""
    needs: tuple[str, ...] = ()
    """Sub-models that the `next:` of a discrete state needs in the same step."""
    fit_over: int | None = None
    """The number of first samples of each run from which the start value is estimated by least
    squares. 0 means the whole run; None means that the state starts at `start`."""

    @property
    def is_buffer(self) -> bool:
        """True if the state is a buffer of samples, which a `Window` shifts by one in each step."""
        return Type(self.axes).window is not None


@dataclass(frozen=True, slots=True)
class Output:
    """A named result of the step. `predicts` is the recorded sample that it predicts, None for
    other outputs.
    """

    name: str
    node: NodeId
    predicts: Prediction | None = None
    doc: str = ""
    span: Span | None = field(default=None, compare=False)
    needs: tuple[str, ...] = ()
    """Sub-models that the output needs in the same step."""


@dataclass(frozen=True, slots=True)
class Expected:
    """The range of values that the spec expects of an equation. No node is computed only for it.

    If the step computes several samples of an equation (`e`, `e[t-3]`), each node has its own
    entry.
    """

    name: str
    node: NodeId
    range: tuple[float, float]
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Formula:
    """The source text of a value, `left` = `right`, shown next to generated code: `travel` = `w -
    z`.
    """

    left: str
    """A name, `der(x)` or `next(x)`."""
    right: str
    span: Span = field(compare=False)


class Measure(Enum):
    """The measure that a loss takes of its errors: a scalar, the mean over steps, rollouts, window
    and dimensions.
    """

    MSE = "mse"
    """Mean of (prediction − target)²."""
    RMSE = "rmse"
    """Mean of (prediction − target)², then the square root per batch."""
    MAE = "mae"
    """Mean of |prediction − target|."""
    HUBER = "huber"
    """Mean of e²/2 for |e| ≤ δ, δ (|e| − δ/2) beyond, with e = prediction − target (Huber 1964)."""
    MEAN = "mean"
    """Mean of the prediction itself, an expression that is already a cost."""


@dataclass(frozen=True, slots=True)
class Loss:
    """One term of the training objective, weight · share · measure.

    Elements whose target is NaN are excluded, as are rows whose factor is 0. If a loss of the spec
    is a sum of measures, its terms are named `entry.mse` and so on.
    """

    name: str
    measure: Measure
    prediction: NodeId
    target: NodeId | None
    weight: float = 1.0
    """The weight of the spec's loss; a training stage can replace it."""
    share: float = 1.0
    """The factor of this term in the sum of the spec's loss."""
    penalty: Penalty | None = None
    span: Span | None = field(default=None, compare=False)
    rows: NodeId | None = None
    """Weight of each row in the mean, a scalar ≥ 0 that depends on the log only; None means 1."""
    delta: float = 1.0
    """δ of `huber`, in the unit of the error. Other measures ignore it."""
    is_default: bool = False
    """True for the default loss of a predicting output, used if the spec has no `losses:`."""

    @property
    def measured(self) -> str:
        """The measure as text for messages, such as `mse`; for another δ than 1 `huber,
        delta 0.5`.
        """
        delta = "" if self.delta == 1.0 else f", delta {self.delta:g}"
        return f"{self.measure.value}{delta}"

    @property
    def nodes(self) -> tuple[NodeId, ...]:
        """The nodes of the step that the loss reads: the prediction, and if they exist the target
        and the weight of the rows.
        """
        others = (node for node in (self.target, self.rows) if node is not None)
        return (self.prediction, *others)

    def moved(self, copies: Mapping[NodeId, NodeId]) -> Loss:
        """The same loss for a copied graph; `copies` maps node ids of the old graph to those of the
        new one. Raises KeyError if it lacks a node that the loss reads.
        """
        return replace(
            self,
            prediction=copies[self.prediction],
            target=None if self.target is None else copies[self.target],
            rows=None if self.rows is None else copies[self.rows],
        )

    @property
    def entry(self) -> str:
        """The name of the loss in the spec's `losses:`, or the name of the output for a default
        loss.
        """
        # names of losses have no dot: losses of sub-models are not part of the program (R11)
        return self.name.partition(".")[0]


@dataclass(frozen=True, slots=True)
class Dimension:
    """A named dimension of the spec; `labels` are the names of its elements, empty
    without names.
    """

    name: str
    size: int
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UsedPlugin:
    """A plug-in that brings something that the spec uses."""

    package: str
    version: str


def with_plugins(plugins: Sequence[UsedPlugin]) -> str:
    """A text with the names and versions of the plug-ins, such as ` with msnn-example 0.1.0`; empty
    without plug-ins.
    """
    named = ", ".join(f"{plugin.package} {plugin.version}" for plugin in plugins)
    return f" with {named}" if named else ""


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled model: pure functions of recorded samples, states and parameters.

    The graph `step` computes one sample t, the graph `start` the states before the first sample t0.
    In *window form*, as compiled, `ReadSignal` nodes read any samples of the inputs. In *step form*
    (`to_step_form`) each input is read once: sample t, a preview [t … t+n] or one delayed sample;
    buffers store the past.
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
    """Expected ranges of equations that outputs, states or losses depend on."""
    fits: tuple[Fit, ...] = ()
    """Layers that training initialises by least squares; empty in a program without losses."""
    dimensions: tuple[Dimension, ...] = ()
    formulas: tuple[Formula, ...] = ()
    """Source texts of equations, outputs and states, for readers of generated code."""
    doc: str = ""
    spec_hash: str = ""
    """SHA-256 of the spec's text, so that weights and generated files can name their source."""
    plugins: tuple[UsedPlugin, ...] = ()
    """Plug-ins that are required to read the spec."""
    late: int = 0
    """Delay of a step form in samples: its step at t is the step of the model at t-late."""

    @property
    def made_by(self) -> str:
        """The version of msnn and of the plug-ins that the spec uses, for the heads of generated
        files.
        """
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
        """The range (lowest, highest) that the spec expects of the equation `name`; None without
        one.
        """
        return next((entry.range for entry in self.expected if entry.name == name), None)
