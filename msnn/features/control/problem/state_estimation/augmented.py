"""Turns estimated parameters into states that stay constant from sample to sample."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadParameter, ReadState
from compiler.ir.program import Declared, Graph, Program, State
from compiler.ir.types import Type


def augmented(program: Program, parameters: Collection[str]) -> Program:
    """The program in whose step these parameters are states, after all others.

    %1: scalar = parameter k

    %1: scalar = state k              # next: itself
    """
    # the log of a parameter is the parameter itself: it is read as a state from here on
    nodes = (
        replace(node, op=ReadState(node.op.name))
        if isinstance(node.op, ReadParameter) and node.op.name in parameters
        else node
        for node in program.step.nodes
    )
    builder, starts = GraphBuilder(Graph(tuple(nodes))), GraphBuilder(program.start)
    states = [
        State(
            name=p.name,
            axes=p.axes,
            unit=p.unit,
            origin=Declared(),
            next=builder.state(p.name, Type(p.axes, p.unit)),
            # the value that training left is where estimation begins
            start=starts.parameter(p.name, Type(p.axes, p.unit)),
            doc=p.doc,
            span=p.span,
        )
        for p in program.parameters
        if p.name in parameters
    ]
    return replace(
        program,
        states=(*program.states, *states),
        step=builder.graph(),
        start=starts.graph(),
    )
