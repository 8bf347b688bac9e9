"""Chooses the structure of the solver's equations; finds states that are past samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from compiler.hessian.step_derivatives import next_value
from compiler.ir import ops
from compiler.ir.program import NodeId, Output, Program, State
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control import ControlProblem

NEWEST = "mpc: newest of "
"""Prefix of the names of outputs that compute the newest sample of a buffer."""


@dataclass(frozen=True, slots=True)
class Sample:
    """An element of x at stage k: the element of a control or of a state s at stage k − lag."""

    is_control: bool
    number: int
    lag: int
    """≥ 1 for a control, 0 for a state itself."""


@dataclass(frozen=True, slots=True)
class WindowForm:
    """A plant whose memory x consists of current and past samples of few states s and of the
    controls u:

    s_{k+1} = f(s_k, s_{k−1}, …, u_k, u_{k−1}, …)
    """

    names: tuple[str, ...]
    """The states of the program that hold some of s, in order."""
    results: tuple[str, ...]
    """What computes their next values: `next_value` of a state, or an output of `program`."""
    sizes: tuple[int, ...]
    """The number of elements of s in each."""
    memory: tuple[Sample, ...]
    """One for each number of x."""
    newest: tuple[int, ...]
    """The indices in x of the elements of s."""
    program: Program
    """The problem's, with an output for the newest sample of each buffer of a computed value."""

    @property
    def states(self) -> int:
        """The number of elements of s."""
        return sum(self.sizes)


def window_form(problem: ControlProblem) -> WindowForm:
    """The window form of a problem: the newest samples of buffers are its states s, older samples
    are past values of s.

    Buffers of a control need no state. States that are no buffers are states s as they are.
    """
    program = problem.program
    names: list[str] = []
    results: list[str] = []
    sizes: list[int] = []
    memory: list[Sample] = []
    newest: list[int] = []
    outputs: list[Output] = []
    controls = {m.name: m for m in problem.controls.members}
    pushed = _pushed(program)
    for state in program.states:
        size = Type(state.axes).size
        if state.name not in pushed:
            first = sum(sizes)
            newest += range(len(memory), len(memory) + size)
            memory += [Sample(is_control=False, number=first + i, lag=0) for i in range(size)]
            names.append(state.name)
            results.append(next_value(state.name))
            sizes.append(size)
            continue
        # windows are last among the axes (R1), so that a row of the buffer is one element's past
        length = state.axes[-1].size
        count = size // length
        control = _signal(program, pushed[state.name])
        if control in controls:
            first = controls[control].first
            memory += [
                Sample(is_control=True, number=first + i, lag=length - j)
                for i in range(count)
                # oldest first: place j of L holds u_{k−L+j}
                for j in range(length)
            ]
            continue
        first = sum(sizes)
        # before `memory` grows: its length is where this buffer begins in x
        newest += [len(memory) + i * length + length - 1 for i in range(count)]
        memory += [
            # and here, with the newest of this stage, s_{k−L+1+j}
            Sample(is_control=False, number=first + i, lag=length - 1 - j)
            for i in range(count)
            for j in range(length)
        ]
        names.append(state.name)
        results.append(NEWEST + state.name)
        sizes.append(count)
        outputs.append(Output(NEWEST + state.name, pushed[state.name]))
    whole = replace(program, outputs=(*program.outputs, *outputs))
    found = tuple(names), tuple(results), tuple(sizes)
    return WindowForm(*found, tuple(memory), tuple(newest), whole)


def signals_held(program: Program) -> dict[str, str]:
    """For each state that is a buffer of past samples of an input or control, the name of that
    signal.
    """
    found = {name: _signal(program, node) for name, node in _pushed(program).items()}
    return {name: signal for name, signal in found.items() if signal is not None}


def _pushed(program: Program) -> dict[str, NodeId]:
    """For each state that is a buffer, the node of the newest sample that a step adds to it."""
    known = {
        node.op.state: node.args[0] for _, node in program.step if isinstance(node.op, ops.Window)
    }
    return {
        state.name: known[state.name] for state in program.states if _is_shifted(program, state)
    }


def _is_shifted(program: Program, state: State) -> bool:
    """True if the state's next value is its window shifted by one sample."""
    node = program.step[state.next]
    if not isinstance(node.op, ops.Slice) or not state.axes:
        return False
    window = program.step[node.args[0]]
    is_own = isinstance(window.op, ops.Window) and window.op.state == state.name
    return is_own and (node.op.start, node.op.stop) == (1, state.axes[-1].size + 1)


def _signal(program: Program, node: NodeId) -> str | None:
    """The name of the signal whose sample at t a node is; None for other nodes."""
    found = program.step[node]
    # reshapes change no number
    while isinstance(found.op, ops.Reshape | ops.Identity):
        found = program.step[found.args[0]]
    op = found.op
    is_sample = isinstance(op, ops.ReadSignal) and (op.first, op.last) == (0, 0)
    return op.signal if isinstance(op, ops.ReadSignal) and is_sample else None


Chosen = Literal["staged", "condensed"]


@dataclass(frozen=True, slots=True)
class ProductEstimate:
    """The approximate number of multiplications per iteration for each structure, without the
    derivatives.
    """

    staged: int
    condensed: int
    states: int
    """Of the window form."""

    @property
    def least(self) -> Chosen:
        """The structure with fewer products."""
        # a tie goes to the recursion, whose memory grows with N and not with its square
        return "condensed" if self.condensed < self.staged else "staged"


def chosen_structure(problem: ControlProblem) -> Chosen:
    """The structure that the spec requests, or for `auto` the one with fewer products."""
    if problem.structure == "auto":
        return estimate(problem).least
    return problem.structure


def estimate(problem: ControlProblem) -> ProductEstimate:
    """The approximate number of products per iteration for each structure; it depends on sizes
    only, not on weights.
    """
    form = window_form(problem)
    n, nx, nu = problem.horizon, problem.states.size, problem.controls.size
    # products of a Riccati step: Aᵀ P A and its sides, the factor of nu, and the gains
    staged = n * (nx * (nx + nu) * (2 * nx + nu) + nu**3 // 3 + nu * nx * (nx + nu))
    return ProductEstimate(staged, _condensed(problem, form), form.states)


def numbers_of(problem: ControlProblem, structure: Chosen) -> int:
    """The approximate number of values in the memory of a controller with this structure, without
    intermediate values and weights.
    """
    n, nx, nu = problem.horizon, problem.states.size, problem.controls.size
    paths = sum(problem.type(path.value).size for path in problem.path_limits)
    # both sides of each limit keep slack, multiplier, excess, the excess's multiplier and steps of
    # these
    sides = 12 * (nu + paths)
    if structure == "staged":
        width = nx + nu
        return n * (width * width + (nx + 1 + paths) * (width + 1) + (nu + 5) * width + sides)
    states = window_form(problem).states
    series = 2 * (nx + n * (states + nu))
    by_stage = (states + 1 + paths) * (states + nu + 1) + (states + nu) ** 2 + 2 * states + sides
    decided = len(problem.blocks) * nu
    return series + n * by_stage + decided**2 + states * decided * n


def _condensed(problem: ControlProblem, form: WindowForm) -> int:
    n, decided = problem.horizon, len(problem.blocks) * problem.controls.size
    samples = sum(1 for sample in form.memory if not sample.is_control)
    sensitivities = form.states * samples * decided * n // 2
    curvature = samples**2 * decided * n // 2 + samples * decided**2 * n // 6
    return sensitivities + curvature + decided**3 // 6
