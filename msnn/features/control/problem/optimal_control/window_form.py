"""Finds which numbers of a plant's memory are samples of others, so that states need not hold them.

A buffer of the last L samples of a control holds u_{k−L} … u_{k−1}: decided at earlier stages, or
known at t. A buffer of a value that the step computes holds that value as it was L times: its
newest sample is a state, the others are the same state at earlier stages. What remains are

    s_{k+1} = f(s_k, s_{k−1}, …, u_k, u_{k−1}, …)

the states s, few where windows are long.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from compiler.hessian.step_derivatives import next_value
from compiler.ir import ops
from compiler.ir.program import NodeId, Output, Program, State
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import ControlProblem

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
    """A plant whose memory x consists of samples of few states s and of the controls u.

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
    """The plant whose state has only the newest sample of each window; the others are past samples.

    Windows of a control need no state; other states remain as they are.
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
    """For each state that is a buffer of past samples, the signal that it stores."""
    found = {name: _signal(program, node) for name, node in _pushed(program).items()}
    return {name: signal for name, signal in found.items() if signal is not None}


def _pushed(program: Program) -> dict[str, NodeId]:
    """The newest sample of each state that is a buffer."""
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
    """The signal whose sample of this step a node is."""
    found = program.step[node]
    # reshapes change no number
    while isinstance(found.op, ops.Reshape | ops.Identity):
        found = program.step[found.args[0]]
    op = found.op
    is_sample = isinstance(op, ops.ReadSignal) and (op.first, op.last) == (0, 0)
    return op.signal if isinstance(op, ops.ReadSignal) and is_sample else None
