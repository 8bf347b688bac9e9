"""Implements dropout in training: multiplies values by random factors, which are series of the
training data.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.ops import Dropout
from compiler.ir.program import Graph, NodeId, Program, Role, Signal
from compiler.ir.types import Axis, Type
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Mask:
    """The signal of the random factors of one dropout, `size` elements per row: 0 with probability
    `rate`, else 1 / (1 − rate).

    With these factors the expected product is the operand (inverted dropout: Srivastava et al.
    2014, section 10).
    """

    signal: str
    rate: float
    size: int


@dataclass(frozen=True, slots=True)
class DrawnDropout:
    """The program of a training stage with dropout, and the masks: signals that its data must
    contain in addition.
    """

    program: Program
    masks: tuple[Mask, ...]


def draw_dropout(program: Program, without: Collection[str]) -> DrawnDropout:
    """Replaces each `Dropout` by the product with the random factors of row t; those of layers in
    `without` are removed.

    Before: any form. After: for training only, since outputs and states may read the log. Example,
    before and after:

        %1: scalar = dropout(%0, 0.2, h)

        %1: [element=1] = log(dropout 1, 0, 0)
        %2: scalar = reshape(%1)
        %3: scalar = %0 * %2
    """
    masks: list[Mask] = []
    program = with_step(program, *_drawn(program.step, without, masks))
    program = with_start(program, *_drawn(program.start, without, masks))
    signals = tuple(Signal(mask.signal, Role.TARGET, (_elements(mask),)) for mask in masks)
    return DrawnDropout(replace(program, signals=(*program.signals, *signals)), tuple(masks))


def _drawn(
    graph: Graph, without: Collection[str], masks: list[Mask]
) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        if not isinstance(node.op, Dropout):
            copies[index] = copy_node(builder, node, args)
        # outside of training and in frozen layers dropout has no effect (R9)
        elif node.op.layer in without or node.op.rate == 0:
            copies[index] = args[0]
        else:
            # numbered over both graphs, so that dropouts are independent
            mask = Mask(f"dropout {len(masks) + 1}", node.op.rate, node.type.size)
            masks.append(mask)
            with builder.at(node.span):
                # the random factors are data (decision 0040): all backends read the same
                factors = builder.log(mask.signal, 0, 0, Type((_elements(mask),)))
                kept = builder.reshape(factors, node.type.axes)
                copies[index] = builder.multiply(args[0], kept)
    return builder.graph(), copies


def _elements(mask: Mask) -> Axis:
    return Axis(f"{mask.signal}.element", mask.size)
