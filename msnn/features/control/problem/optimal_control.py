"""Defines the optimal control problem of a predictive controller, as data for every solver.

Let x be all memory of one step of the plant, u the controls, d the measured disturbances and r the
references. At each sample t, from the measured x_0, the controller finds u_0 … u_{N-1} that make

    J = Σ_{k=0}^{N-1} l(x_k, u_k, d_k, r_k) + l_N(x_N, d_N, r_N)
        + Σ_soft Σ_k (w₁ · v + w₂ · v²),     v = max(g_min − g, g − g_max, 0), element by element

as small as it can be, subject to

    x_{k+1} = F(x_k, u_k, d_k)                                  k = 0 … N−1
    u_min(r_k) ≤ u_k ≤ u_max(r_k)                               k = 0 … N−1, always kept
    |u_k − u_{k−1}| ≤ rate                                      k = 0 … N−1, u_{−1} is in x_0
    u_k = u_{k+1}                                               within a block
    g_min(r_k) ≤ g(x_k, u_k, d_k, r_k) ≤ g_max(r_k)             k = 0 … N−1 where g reads a control
                                                                in the same step, else k = 1 … N

F, l, l_N, g and the limits are all one `Program` in step form: F its next states, the others its
outputs, by the names that the fields below have. A limit and l_N are outputs like the others, which
read less: `reads` says what.

x holds u_{k−1} of a control with a rate, and of all where a block is longer than a sample:
`previous` says where. Derivatives are those of the program: `compiler.hessian.step_derivatives`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from compiler.ir.nodes import needed
from compiler.ir.ops import ReadSignal, ReadState, Window
from compiler.ir.program import History, NodeId, Program, Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

Curvature = Literal["exact", "gauss_newton"]
"""Whose second derivatives the solver takes: all of the Lagrangian, or those of the cost alone.

`gauss_newton` leaves out what plant and bounds curve, and takes the nearest convex curvature of the
cost: for a sum of squares of affine functions of x and u it is the classical one.
"""
Structure = Literal["auto", "staged", "condensed"]
Mode = Literal["converged", "fixed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The names of the outputs that compute a minimum and a maximum from references alone; None
    without a limit.

    An output has the axes of the limited value, or none: then it is one number for all elements.
    """

    minimum: str | None
    maximum: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLimits:
    """The limits of one control, which always hold, even for a control returned after a failure."""

    name: str
    """Of the control, a member of `ControlProblem.controls`."""
    limits: Limits
    rate: float | None
    """Most that each element moves from one sample to the next, in the unit of the control."""
    scale: float
    """Typical size of a change, in its unit: half of what its range or its bounds leave, else 1."""
    span: Span | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PathLimits:
    """Limits along the horizon of a value g: a state, an output or an equation."""

    name: str
    """As the spec has it."""
    value: str
    """The output of the program that computes g."""
    limits: Limits
    reads_control: bool
    """Whether g depends on a control of the same step: bounded at k = 0 … N−1, else at 1 … N."""
    hard: bool
    linear: float | None
    """w₁, cost of a violation by one unit; None where it follows from the cost (`trained`)."""
    quadratic: float | None
    """w₂, cost of the square of a violation by one unit; None as above."""
    scale: float
    """Typical size of a change, in its unit: half of what its range or its bounds leave, else 1."""
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Reads:
    """The names of the states and signals on which a value depends within its step."""

    states: frozenset[str]
    signals: frozenset[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlProblem:
    """An optimal control problem; the docstring of this file states it.

    A Vector lists quantities by name, with axes, unit and the index of their first element;
    elements of a quantity are in C order of its axes, the window last.
    """

    program: Program
    """In step form, loops closed, without losses. Every port has the sample of its own k first."""
    states: Vector
    """x: declared states, what layers remember, and shift registers (`registers`)."""
    controls: Vector
    """u: in the order of the spec."""
    disturbances: Vector
    """d: ports that are neither controls nor references. One with a window axis holds the samples
    k … k+ahead."""
    references: Vector
    """r: one sample each."""
    previewed: frozenset[str]
    """Disturbances given at t … t+N−1 and references given at t … t+N. All others, and what is
    asked for beyond the last sample given, are held."""
    stage: str
    """The output that is l, a number."""
    terminal: str | None
    """The output that is l_N, a number that depends on no control of its step; None for 0."""
    control_limits: tuple[ControlLimits, ...]
    """One for each control, in their order."""
    path_limits: tuple[PathLimits, ...]
    horizon: int
    """N."""
    blocks: tuple[int, ...]
    """Samples over which u stays the same; they sum to N. All 1 where the spec says nothing."""
    state_scales: Mapping[str, float]
    """Typical change of each state: half of its range or of its bounds, else 1."""
    hessian: Curvature
    structure: Structure
    mode: Mode
    iterations: int
    tolerance: float
    cost_scale: float = 1.0
    """σ: solvers solve for σJ, whose size fits tolerance and barriers (`cost_scale.cost_scale`)."""
    flat: frozenset[str] = frozenset()
    """Next values and outputs whose curvature the solver leaves out, as `step_derivatives` does."""

    @property
    def starts_again(self) -> bool:
        """True if a solve that fails from the previous plan is tried once more from rest."""
        # in the mode `fixed` a second solve would take twice the time that was promised
        return self.mode == "converged"

    @property
    def most_iterations(self) -> int:
        """The maximum number of iterations per sample, with those of a second try."""
        return self.iterations * (2 if self.starts_again else 1)

    @property
    def sample_time(self) -> float:
        """Seconds from one k to the next."""
        assert self.program.sample_time is not None
        return self.program.sample_time

    @property
    def has_blocks(self) -> bool:
        """True if controls stay constant over blocks of several samples."""
        return max(self.blocks) > 1

    @property
    def registers(self) -> dict[str, History | Tape]:
        """The states that are shift registers of past samples, oldest first, by name.

        A `History` of an input s has the samples before k; a `Tape` of a signal that outputs
        predict has those up to k+ahead−1.
        """
        found = {state.name: state.origin for state in self.program.states}
        return {n: o for n, o in found.items() if isinstance(o, History | Tape)}

    @property
    def longest_preview(self) -> int:
        """The longest preview of a disturbance in samples, the current one included; at least 1."""
        windows = [Type(member.axes).window or 1 for member in self.disturbances.members]
        return max(windows, default=1)

    def previous(self, control: str) -> tuple[int, ...] | None:
        """The indices in x of the elements of u_{k−1} of a control; None if x does not contain
        them.
        """
        name = f"{control}.history"
        # only a control with a rate, or in a block, has a register
        if all(member.name != name for member in self.states.members):
            return None
        member = self.states.member(name)
        length = member.axes[-1].size
        # the newest sample of each row of the register: windows end with it (R1)
        return tuple(range(member.first + length - 1, member.first + member.size, length))

    def node(self, output: str) -> NodeId:
        """The node of an output in the graph of the program's step."""
        return self.program.output(output).node

    def type(self, output: str) -> Type:
        """The axes and the unit of an output."""
        return self.program.step[self.node(output)].type

    def reads(self, *nodes: NodeId) -> Reads:
        """The states and signals on which these nodes of the step depend within the step."""
        graph = self.program.step
        live = needed(graph, nodes)
        ops = [node.op for index, node in graph if live[index]]
        states = {op.name for op in ops if isinstance(op, ReadState)}
        # a `Window` reads its state's buffer without naming it in an operation of its own
        states |= {op.state for op in ops if isinstance(op, Window)}
        signals = {op.signal for op in ops if isinstance(op, ReadSignal)}
        return Reads(frozenset(states), frozenset(signals))
