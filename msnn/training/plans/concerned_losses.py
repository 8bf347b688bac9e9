"""Determines if the losses of a stage depend on its trained parameters and on data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from compiler.ir.nodes import needed, needed_over_time
from compiler.ir.ops import ReadParameter, ReadSamples, ReadState, Window
from compiler.ir.program import Graph, Program


def concerns(program: Program, weights: Mapping[str, float], trained: Sequence[str]) -> bool:
    """True if a weighted loss depends on a trained parameter, at any step of a rollout."""
    counted = [loss for loss in program.losses if weights[loss.name]]
    wanted = [n for loss in counted for n in loss.nodes]
    following = {state.name: state.next for state in program.states}
    live, states = needed_over_time(program.step, following, wanted)
    first = needed(program.start, [s.start for s in program.states if s.name in states])
    read = _read(program.step, live) | _read(program.start, first)
    return not read.isdisjoint(trained)


def of_parameters_alone(program: Program, weights: Mapping[str, float]) -> bool:
    """True if the weighted losses depend on parameters only, not on data."""
    counted = [node for loss in program.losses if weights[loss.name] for node in loss.nodes]
    live = zip(needed(program.step, counted), program.step, strict=True)
    kinds = ReadSamples | ReadState | Window
    return not any(kept and isinstance(node.op, kinds) for kept, (_, node) in live)


def _read(graph: Graph, live: Sequence[bool]) -> set[str]:
    return {
        node.op.name
        for kept, (_, node) in zip(live, graph, strict=True)
        if kept and isinstance(node.op, ReadParameter)
    }
