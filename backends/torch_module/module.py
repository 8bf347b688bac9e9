"""Builds a `torch.nn.Module` of a program: a differentiable step and start."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from backends.ports.identifiers import c_identifier
from backends.raw_parameters import Mapping as RawMapping
from backends.raw_parameters import is_off_bounds, mapping_of, raw_value
from backends.torch_module.lowering import (
    GivenNode,
    LoweredGraph,
    TorchLeaf,
    lower_graph,
    prepared,
    static_nodes,
)
from compiler.ir import ops
from compiler.ir.program import Graph, NodeId, Parameter, Program

FloatArray = NDArray[np.float64]

Windows = Callable[[str, int, int], Tensor]
"""(signal, first, last) → samples t+first … t+last, a tensor (B, *shape, last−first+1)."""


@dataclass(frozen=True, slots=True)
class TorchStep:
    """The results of one step by name, as tensors (B, *shape)."""

    outputs: dict[str, Tensor]
    next_states: dict[str, Tensor]
    losses: dict[str, tuple[Tensor, Tensor | None]]
    """Prediction and target of every loss."""
    rows: dict[str, Tensor]
    """The row factors of losses that have them."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Values that all steps share until parameters change: physical parameters by name, and nodes
    that depend on parameters only, of the graphs of the step and the start, by node id.
    """

    physical: dict[str, Tensor]
    step: dict[NodeId, Tensor]
    start: dict[NodeId, Tensor]


@dataclass(frozen=True, slots=True)
class _Loaded:
    """Names of the two buffers of a parameter that keep the raw variable and the physical value of
    the last load.
    """

    raw: str
    physical: str


def build_module(
    program: Program, dtype: torch.dtype = torch.float64, device: str = "cpu"
) -> TorchModel:
    """A torch module of the program, in window or step form, with tensors of this type on this
    device (a torch name such as `cpu`). Its parameters begin with the initial values of the spec.
    """
    return TorchModel(program, dtype, torch.device(device))


class TorchModel(nn.Module):
    """A program in torch. Its torch parameters are the raw variables; `physical()` gives physical
    values.

    The map from raw to physical values rounds. An element whose raw variable has not changed since
    loading therefore returns the loaded value, bit for bit, with the gradient of the map. A log is
    one tensor (rows, *shape) per signal; `t` are the rows (B,) at which steps run; states and
    outputs are (B, *shape).
    """

    def __init__(self, program: Program, dtype: torch.dtype, device: torch.device) -> None:
        super().__init__()
        # raw variables belong to the given program: `prepared` adds no parameters
        self._given = program
        self.dtype, self.device = dtype, device
        self._loaded: dict[str, _Loaded] = {}
        self._names = self._add_parameters()

    @cached_property
    def program(self) -> Program:
        """The program with the changes that torch needs (`prepared`); its parameters are those of
        the given one.
        """
        return prepared(self._given)

    @cached_property
    def _step(self) -> _Evaluator:
        """The torch code of the step, lowered at its first use, as training in a kernel needs only
        the variables.
        """
        roots = _step_roots(self.program)
        return _Evaluator(self.program.step, roots, self.dtype, self.device)

    @cached_property
    def _start(self) -> _Evaluator:
        roots = [state.start for state in self.program.states]
        return _Evaluator(self.program.start, roots, self.dtype, self.device)

    def _add_parameters(self) -> dict[str, str]:
        # parameters are attributes: one named `train` would hide the method
        taken = set(dir(self))
        names: dict[str, str] = {}
        for parameter in self._given.parameters:
            name = names[parameter.name] = c_identifier(parameter.name, taken)
            shape = tuple(axis.size for axis in parameter.axes)
            initial = np.asarray(parameter.initial, dtype=np.float64).reshape(shape)
            if parameter.learn:
                raw, _ = raw_value(parameter, initial)
                # optimisers change raw variables, all values of which are within the bounds
                self.register_parameter(name, nn.Parameter(self._tensor(raw)))
                if _rounds(parameter):
                    loaded = self._loaded[parameter.name] = _Loaded(
                        c_identifier(f"{parameter.name}_loaded_raw", taken),
                        c_identifier(f"{parameter.name}_loaded", taken),
                    )
                    for buffer, value in ((loaded.raw, raw), (loaded.physical, initial)):
                        self.register_buffer(buffer, self._tensor(value), persistent=False)
            else:
                self.register_buffer(name, self._tensor(initial))
        return names

    def _tensor(self, value: FloatArray) -> Tensor:
        return torch.tensor(value, dtype=self.dtype, device=self.device)

    def raw(self, name: str) -> Tensor:
        """The tensor of a parameter in the module: its raw variable if it is learned, otherwise its
        physical value. Raises KeyError for an unknown name.
        """
        return getattr(self, self._names[name])

    def physical(self) -> dict[str, Tensor]:
        """Physical values of all parameters by name, differentiable with respect to the raw
        variables.
        """
        return {
            p.name: self._physical(p) if p.learn else self.raw(p.name)
            for p in self._given.parameters
        }

    def _physical(self, parameter: Parameter) -> Tensor:
        raw, loaded = self.raw(parameter.name), self._loaded.get(parameter.name)
        mapped = physical_value(parameter, raw)
        if loaded is None:
            return mapped
        same = raw == self.get_buffer(loaded.raw)
        # the added difference is 0 but has the gradient of the map
        return torch.where(
            same, self.get_buffer(loaded.physical) + (mapped - mapped.detach()), mapped
        )

    def load_physical(
        self, weights: Mapping[str, FloatArray], moving: Collection[str] = ()
    ) -> tuple[str, ...]:
        """Sets the named parameters to these physical values, in place. A value on a bound has no
        finite raw variable and is moved off it. Elements of parameters in `moving` then have the
        moved value; all others have exactly the loaded one. Returns the names in `moving` that were
        moved.
        """
        moved: list[str] = []
        # loading is not differentiated
        with torch.no_grad():
            for name, value in weights.items():
                parameter = self._given.parameter(name)
                raw, off = raw_value(parameter, value) if parameter.learn else (value, False)
                self.raw(name).copy_(self._tensor(raw))
                if off and name in moving:
                    moved.append(name)
                loaded = self._loaded.get(name)
                if loaded is not None:
                    own = self.raw(name)
                    kept = self._tensor(value)
                    if off and name in moving:
                        still = torch.as_tensor(is_off_bounds(parameter, value), device=self.device)
                        kept = torch.where(still, kept, physical_value(parameter, own))
                    self.get_buffer(loaded.raw).copy_(own)
                    self.get_buffer(loaded.physical).copy_(kept)
        return tuple(moved)

    def weights(self) -> dict[str, FloatArray]:
        """Copies of the physical values by name, as float64 arrays, as in weight files."""
        with torch.no_grad():
            return {
                # a copy, since the tensor changes later
                name: value.detach().to("cpu", torch.float64).numpy().copy()
                for name, value in self.physical().items()
            }

    def frame(self) -> Frame:
        """Computes the values that all steps share. It is valid until parameters change."""
        return self.frame_of(self.physical())

    def frame_of(self, physical: dict[str, Tensor]) -> Frame:
        """Computes the values that all steps share, from these physical values by name instead of
        the module's.
        """
        return Frame(physical, self._step.prepare(physical), self._start.prepare(physical))

    @contextmanager
    def constants_with_tangents(self, zero: Tensor) -> Generator[None]:
        """Context manager for forward-mode differentiation: within it, constants have zero
        tangents. `zero` is the tensor 0 with a zero tangent. Otherwise torch computes the shape of
        each missing tangent in Python, in every operation. Graphs with possibly infinite values are
        not changed (decision 0396).
        """
        program = self.program
        constants = [
            (code.module, name, value)
            for graph, evaluator in ((program.step, self._step), (program.start, self._start))
            if stays_finite(graph)
            for code in evaluator.codes
            for name, value in code.module.named_buffers()
            if value.is_floating_point()
        ]
        try:
            for module, name, value in constants:
                setattr(module, name, value - zero)  # -0.0 + 0.0 would be 0.0
            yield
        finally:
            for module, name, value in constants:
                setattr(module, name, value)

    def start(self, log: Mapping[str, Tensor], t: Tensor) -> dict[str, Tensor]:
        """The states before the step at the rows `t` (B,), by name, from a log."""
        return self.start_on(gathered(log, t), self.frame(), len(t))

    def step(self, log: Mapping[str, Tensor], t: Tensor, states: Mapping[str, Tensor]) -> TorchStep:
        """Outputs, next states and values of losses of the step at the rows `t` (B,), from a log
        and the states by name.
        """
        return self.step_on(gathered(log, t), states, self.frame(), len(t))

    def start_on(self, windows: Windows, frame: Frame, batch: int) -> dict[str, Tensor]:
        """The states before the first step by name, from windows that the caller took from the log,
        and a frame. `batch` is B.
        """
        values = self._start.run(windows, {}, frame.physical, frame.start, batch)
        return {state.name: value for state, value in zip(self.program.states, values, strict=True)}

    def step_on(
        self, windows: Windows, states: Mapping[str, Tensor], frame: Frame, batch: int
    ) -> TorchStep:
        """The results of one step, from windows that the caller took from the log, the states, and
        a frame. `batch` is B.
        """
        values = iter(self._step.run(windows, states, frame.physical, frame.step, batch))
        outputs = {output.name: next(values) for output in self.program.outputs}
        next_states = {state.name: next(values) for state in self.program.states}
        losses = {
            loss.name: (next(values), None if loss.target is None else next(values))
            for loss in self.program.losses
        }
        rows = {loss.name: next(values) for loss in self.program.losses if loss.rows is not None}
        return TorchStep(outputs, next_states, losses, rows)


def _rounds(parameter: Parameter) -> bool:
    """True if the parameter has a scale or bounds, so that its physical value is computed from the
    raw variable and rounded.
    """
    return parameter.scale != 1.0 or mapping_of(parameter) is not RawMapping.LINEAR


def gathered(log: Mapping[str, Tensor], t: Tensor) -> Windows:
    """A function that reads samples of the log around the rows `t` (B,): (signal, first, last) →
    (B, *shape, last−first+1).
    """

    def windows(signal: str, first: int, last: int) -> Tensor:
        # rows of each member: (B, window), then the window last (R1)
        rows = t[:, None] + torch.arange(first, last + 1, device=t.device)
        return torch.movedim(log[signal][rows], 1, -1)

    return windows


def _step_roots(program: Program) -> list[NodeId]:
    roots = [output.node for output in program.outputs]
    roots += [state.next for state in program.states]
    for loss in program.losses:
        roots.append(loss.prediction)
        if loss.target is not None:
            roots.append(loss.target)
    roots += [loss.rows for loss in program.losses if loss.rows is not None]
    return roots


class _Evaluator:
    """Torch code of a graph in two pieces: nodes that depend on parameters only, computed once by
    `prepare`, and all others, computed by `run` in each step.
    """

    def __init__(
        self, graph: Graph, roots: list[NodeId], dtype: torch.dtype, device: torch.device
    ) -> None:
        static = static_nodes(graph)
        used = {arg for index, node in graph if not static[index] for arg in node.args}
        # static values that other nodes use: the interface of the two pieces
        self._shared = sorted(
            index
            for index in used | set(roots)
            if static[index] and not isinstance(graph[index].op, ops.Constant | ops.ReadParameter)
        )
        self._before = lower_graph(graph, self._shared, dtype) if self._shared else None
        self._main = lower_graph(graph, roots, dtype, given=frozenset(self._shared))
        self.codes = [self._main] if self._before is None else [self._before, self._main]
        for code in self.codes:
            code.module.to(device)
        # a static result is finally repeated along the batch
        self._shapes = [graph[root].type.shape if static[root] else None for root in roots]

    def prepare(self, physical: Mapping[str, Tensor]) -> dict[NodeId, Tensor]:
        if self._before is None:
            return {}
        values = self._before(_arguments(self._before, None, {}, physical, {}))
        return dict(zip(self._shared, values, strict=True))

    def run(
        self,
        windows: Windows,
        states: Mapping[str, Tensor],
        physical: Mapping[str, Tensor],
        shared: Mapping[NodeId, Tensor],
        batch: int,
    ) -> list[Tensor]:
        values = self._main(_arguments(self._main, windows, states, physical, shared))
        return [
            value if shape is None else value.expand((batch, *shape))
            for value, shape in zip(values, self._shapes, strict=True)
        ]


def _arguments(
    code: LoweredGraph,
    windows: Windows | None,
    states: Mapping[str, Tensor],
    physical: Mapping[str, Tensor],
    shared: Mapping[NodeId, Tensor],
) -> list[Tensor]:
    return [_argument(leaf, windows, states, physical, shared) for leaf in code.leaves]


def _argument(
    leaf: TorchLeaf,
    windows: Windows | None,
    states: Mapping[str, Tensor],
    physical: Mapping[str, Tensor],
    shared: Mapping[NodeId, Tensor],
) -> Tensor:
    match leaf.source:
        case ops.ReadParameter(name):
            return physical[name]
        case ops.ReadState(name):
            return states[name]
        case ops.ReadTraining():
            raise AssertionError("no program reads values of training")
        case GivenNode(node):
            return shared[node]
        case ops.ReadSignal(signal, first, last) | ops.ReadLog(signal, first, last):
            assert windows is not None, "parameters alone decide the shared part"
            window = windows(signal, first, last)
            return window if leaf.windowed else window[..., 0]


def physical_value(parameter: Parameter, raw: Tensor) -> Tensor:
    """The physical value of a raw variable, in the same shape; differentiable. Its bounds and scale
    are those of the parameter.
    """
    match parameter.minimum, parameter.maximum:
        case None, None:
            return raw * parameter.scale
        case float(low), None:
            return low + parameter.scale * _softplus(raw)
        case None, float(high):
            return high - parameter.scale * _softplus(-raw)
        case float(low), float(high):
            # one sigmoid per side: |raw| would have the wrong derivative at 0
            span = high - low
            above, below = high - span * torch.sigmoid(-raw), low + span * torch.sigmoid(raw)
            return torch.where(raw > 0, above, below)
        case _:
            raise AssertionError("bounds are floats or None")


def _softplus(raw: Tensor) -> Tensor:
    # torch's softplus is x above 20, with another derivative than the kernels
    return torch.logaddexp(raw, torch.zeros_like(raw))


_FINITE = frozenset({"sin", "cos", "atan", "tanh", "sigmoid", "softplus", "abs", "sign"})
"""Functions that are finite, with finite derivatives, everywhere."""


def stays_finite(graph: Graph) -> bool:
    """True if all operations of a graph have finite values and derivatives for finite operands,
    except for overflow. A divisor that depends on parameters only does not count: at 0 the model
    itself is infinite.
    """
    static = static_nodes(graph)
    for _, node in graph:
        match node.op:
            case ops.Divide() if not static[node.args[1]]:
                return False
            case ops.Apply(function) if function not in _FINITE:
                return False
            case _:
                pass
    return True
