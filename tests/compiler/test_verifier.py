"""The verifier: legal programs pass, and each rule refuses a program that breaks it alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from compiler.ir import ops
from compiler.ir.ops import StateAdjoint
from compiler.ir.program import (
    Declared,
    Dimension,
    Graph,
    History,
    Loss,
    Measure,
    Node,
    NodeId,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
    Tape,
)
from compiler.ir.rules import LARGEST_SIZE, MOST_AXES
from compiler.ir.types import Axis, Kind, Prediction, Type
from compiler.ir.verifier import InvalidProgram, verify
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from tests.programs import SAMPLES

K, T = Axis("k", 3), Axis("t", 4)
NODES = (
    Node(ops.ReadSignal("s", 0, 0), (), Type((K,))),
    Node(ops.ReadParameter("p"), (), Type((K,))),
    Node(ops.ReadState("x"), (), Type((K,))),
    Node(ops.Compare(ops.Relation.LESS), (0, 1), Type((K,), kind="bool")),
    Node(ops.ReadLog("s", 0, 0), (), Type((K,))),
    Node(ops.ReadSignal("s", -3, 0), (), Type((K, T))),
    Node(ops.Window("h"), (0,), Type((K, T))),
    Node(ops.Slice("t", 1, 4), (6,), Type((K, Axis("t", 3)))),
)
BASE = Program(
    name="base",
    sample_time=1.0,
    signals=(Signal("s", Role.INPUT, (K,)),),
    parameters=(Parameter("p", (K,), initial=(1.0, 2.0, 3.0)),),
    states=(
        State("x", (K,), None, Declared(), 0, 0),
        State("h", (K, Axis("t", 3)), None, History("s"), 7, 1),
    ),
    step=Graph(NODES),
    start=Graph(
        (
            Node(ops.ReadLog("s", 0, 0), (), Type((K,))),
            Node(ops.ReadLog("s", -3, -1), (), Type((K, Axis("t", 3)))),
        )
    ),
    outputs=(Output("y", 2),),
    losses=(Loss("fit", Measure.MSE, 2, 4),),
)


def _with(op: ops.Op, args: tuple[NodeId, ...], *axes: Axis, kind: Kind = "real") -> Program:
    """The base with one more node in its step."""
    return replace(BASE, step=Graph((*NODES, Node(op, args, Type(axes, kind=kind)))))


def _state(**changes: object) -> Program:
    first, *rest = BASE.states
    return replace(BASE, states=(replace(first, **changes), *rest))


def _parameter(**changes: object) -> Program:
    return replace(BASE, parameters=(replace(BASE.parameters[0], **changes),))


def _output(**changes: object) -> Program:
    return replace(BASE, outputs=(replace(BASE.outputs[0], **changes),))


def _loss(**changes: object) -> Program:
    return replace(BASE, losses=(replace(BASE.losses[0], **changes),))


NAN, INFINITY = float("nan"), float("inf")

BROKEN: dict[str, Program] = {
    # nodes
    "uses a node that does not stand before it": _with(ops.Negate(), (8,), K),
    "node 8: Negate: 2 operands, not 1": _with(ops.Negate(), (0, 1), K),
    "node 8: Concat: 0 operands, not 1": _with(ops.Concat("k"), (), K),
    "Constant: 2 numbers for [k=3]": _with(ops.Constant((1.0, 2.0)), (), K),
    "Constant: 3 numbers for [k=3], or one is not finite": _with(
        ops.Constant((1.0, NAN, 2.0)), (), K
    ),
    "there is no parameter `q`": _with(ops.ReadParameter("q"), (), K),
    "parameter `p` has axes [k=3]": _with(ops.ReadParameter("p"), ()),
    "a program reads no value of training": _with(ops.ReadTraining(StateAdjoint("x")), (), K),
    "there is no state `z`": _with(ops.ReadState("z"), (), K),
    "there is no signal `q`": _with(ops.ReadSignal("q", 0, 0), (), K),
    "samples 1 … 0 are no window": _with(ops.ReadSignal("s", 1, 0), (), K),
    "samples -99999999 … 0 are no window": _with(ops.ReadSignal("s", -99999999, 0), (), K, T),
    "several samples need a window axis": _with(ops.ReadSignal("s", -3, 0), (), K),
    "signal `s` has axes [k=3, t=2]": _with(ops.ReadSignal("s", -1, 0), (), K, T),
    "Add: an operand has axes [k=3, t=4]": _with(ops.Add(), (0, 5), K),
    "Add: a bool where a number belongs": _with(ops.Add(), (3, 3), K),
    "Clamp: an operand has axes [k=3, t=4]": _with(ops.Clamp(), (0, 1, 5), K),
    "Compare: a comparison is a bool": _with(ops.Compare(ops.Relation.LESS), (0, 1), K),
    "Select: the condition is not a bool": _with(ops.Select(), (0, 1, 2), K),
    "Select: a bool where a number belongs": _with(ops.Select(), (3, 3, 2), K),
    "a value is named by no proper name": _with(ops.Named("a\nb"), (0,), K),
    "Named: a name changes no kind": _with(ops.Named("e"), (3,), K),
    "there is no function `gamma`": _with(ops.Apply("gamma"), (0,), K),
    "Apply: 1 operands, not 2": _with(ops.Apply("atan2"), (0,), K),
    "Broadcast: [k=3] does not fit in the result": _with(ops.Broadcast(), (0,), T),
    "Reshape: [k=3] has another size": _with(ops.Reshape(), (0,), T),
    "`t` 1:9 is no part of [k=3, t=4]": _with(ops.Slice("t", 1, 9), (5,), K, Axis("t", 8)),
    "`t` 2:2 is no part of [k=3, t=4]": _with(ops.Slice("t", 2, 2), (5,), K),
    "`j` 0:1 is no part of [k=3]": _with(ops.Slice("j", 0, 1), (0,), K),
    "not the slice's axes": _with(ops.Slice("t", 1, 3), (5,), K, T),
    "[k=3, t=4] does not join along `k`": _with(ops.Concat("k"), (0, 5), Axis("k", 6)),
    "not the sum over `k`": _with(ops.Sum("k"), (5,), K),
    "`j` is not an axis of equal length on both sides": _with(ops.Contract("j"), (0, 1)),
    "not the axes of both without the contracted one": _with(ops.Contract("k"), (0, 5), K),
    "there is no buffer `x`": _with(ops.Window("x"), (0,), K, T),
    "buffer `h` has axes [k=3, t=3]": _with(ops.Window("h"), (0,), K, Axis("t", 3)),
    "[k=3, k=3] has an axis twice": _with(ops.Broadcast(), (0,), K, K),
    "[t=4, k=3] has the window before the end": _with(ops.Broadcast(), (5,), T, K),
    "[k=3, _=0] has too many axes or an empty one": _with(ops.Broadcast(), (0,), K, Axis("", 0)),
    "has too many axes": _with(
        ops.Broadcast(), (0,), K, *(Axis(f"a{i}", 1) for i in range(MOST_AXES))
    ),
    "elements": _with(ops.Broadcast(), (0,), K, Axis("big", LARGEST_SIZE)),
    "an axis has no proper name": _with(ops.Broadcast(), (0,), K, Axis("a\nb", 2)),
    # declarations
    "a program has no proper name": replace(BASE, name="two\nlines"),
    "the sample time is not a positive number": replace(BASE, sample_time=0.0),
    "signal `s` is there twice": replace(BASE, signals=BASE.signals * 2),
    "parameter `p` is there twice": replace(BASE, parameters=BASE.parameters * 2),
    "state `x` is there twice": replace(BASE, states=(BASE.states[0], *BASE.states)),
    "output `y` is there twice": replace(BASE, outputs=BASE.outputs * 2),
    "loss `fit` is there twice": replace(BASE, losses=BASE.losses * 2),
    "dimension `k` is there twice": replace(BASE, dimensions=(Dimension("k", 3),) * 2),
    "signal `s` has an axis that is no dimension": replace(
        BASE, signals=(Signal("s", Role.INPUT, (K, T)),)
    ),
    "signal `s` has an empty range": replace(
        BASE, signals=(Signal("s", Role.INPUT, (K,), range=(1.0, 1.0)),)
    ),
    "parameter `p` has not one finite number an element": _parameter(initial=(1.0,)),
    "parameter `p` has no positive scale": _parameter(scale=0.0),
    "parameter `p` starts outside its bounds": _parameter(minimum=1.5),
    "state `x` has an empty range": _state(range=(2.0, NAN)),
    "state `x` is a buffer without a window": _state(origin=History("s")),
    "state `x` is the tape of no signal": _state(origin=Tape("q", 1)),
    "state `x` has other axes than its next value": _state(next=5),
    "state `x` has other axes than its start value": _state(start=1),
    "output `y` is no number": _output(node=3),
    "output `y` predicts no signal": _output(predicts=Prediction("q", 1)),
    "loss `fit` has no number to score": _loss(prediction=3),
    "loss `fit` compares values of different axes": _loss(target=5),
    "loss `fit` has no finite weight": _loss(weight=INFINITY),
    "loss `fit` has no number for each row": _loss(rows=4),
    # what may read what
    "the start reads the simulation": replace(
        BASE, start=Graph((*BASE.start.nodes, Node(ops.ReadState("x"), (), Type((K,)))))
    ),
    "node 4: an output or its state reads the log": _output(node=4),
    "node 0: a target reads the simulation": _loss(target=0),
}


def test_the_base_of_the_broken_programs_is_legal() -> None:
    verify(BASE)


@pytest.mark.parametrize("reason", BROKEN)
def test_broken_program_is_refused(reason: str) -> None:
    with pytest.raises(InvalidProgram) as raised:
        verify(BROKEN[reason])
    assert reason in raised.value.reason


def test_fault_of_a_node_names_the_node() -> None:
    with pytest.raises(InvalidProgram) as raised:
        verify(BROKEN["node 8: Negate: 2 operands, not 1"])
    assert raised.value.node == Node(ops.Negate(), (0, 1), Type((K,)))


FORMS: dict[str, Callable[[Program], Program]] = {
    "window form": lambda program: program,
    "step form": to_step_form,
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", SAMPLES)
def test_samples_are_legal(name: str, form: str) -> None:
    sample = SAMPLES[name]()
    verify(FORMS[form](sample.program))
    verify(FORMS[form](close_loop(sample.program, sample.closed)))
