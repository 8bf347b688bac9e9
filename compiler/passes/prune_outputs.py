"""Reduces a program to what some of its outputs need: the deployed part of a model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from compiler.passes.drop_unused import drop_unused
from compiler.program import Program


def prune_outputs(program: Program, names: Iterable[str]) -> Program:
    """The program with the named outputs only, the states that they need, and no losses.

    Exporting the controller of a closed loop drops the plant with all that only it or a loss reads.

    Before and after: any form. Raises KeyError for a name that no output has.

        output command = %7
        output plant = %13          # pruned to command: %8 … %13 go too
    """
    wanted = dict.fromkeys(names)
    known = {output.name for output in program.outputs}
    for name in wanted:
        if name not in known:
            raise KeyError(name)
    outputs = tuple(output for output in program.outputs if output.name in wanted)
    return drop_unused(replace(program, outputs=outputs, losses=()))
