"""Determines which parameters the training stages change, and counts their elements."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from compiler.ir.program import Program
from compiler.ir.types import Type
from spec_schema.sections.training import Stage


def is_frozen(name: str, stage: Stage) -> bool:
    """True if a stage keeps the parameter at the value with which the stage begins."""
    return any(fnmatchcase(name, pattern.value) for pattern in stage.freeze)


def learned_numbers(program: Program, stages: Sequence[Stage]) -> int:
    """The number of elements that training changes; a parameter frozen in all stages is a constant.

    Without stages, every parameter with `learn` counts, because another tool may train it.
    """
    return sum(
        Type(parameter.axes).size
        for parameter in program.parameters
        if parameter.learn and (not stages or any(_moves(parameter.name, s) for s in stages))
    )


def _moves(name: str, stage: Stage) -> bool:
    # the last matching factor counts; a parameter with learning rate 0 stays as it is
    factors = [each.value for pattern, each in stage.lr.items() if fnmatchcase(name, pattern)]
    return not is_frozen(name, stage) and (not factors or factors[-1] != 0.0)
