"""Tells which parameters the stages of a spec move, and how many numbers these are."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from compiler.ir.program import Program
from compiler.ir.types import Type
from spec_schema.sections.training.training import Stage


def is_frozen(name: str, stage: Stage) -> bool:
    """Whether a stage holds a parameter at the value with which the stage begins."""
    return any(fnmatchcase(name, pattern.value) for pattern in stage.freeze)


def learned_numbers(program: Program, stages: Sequence[Stage]) -> int:
    """The count of numbers that training moves: what all stages hold is as good as a constant.

    A spec without stages leaves training to others, which may move all that it lets them.
    """
    return sum(
        Type(parameter.axes).size
        for parameter in program.parameters
        if parameter.learn and (not stages or any(_moves(parameter.name, s) for s in stages))
    )


def _moves(name: str, stage: Stage) -> bool:
    # of several factors the last one that is written counts; what has the rate 0 stays as it is
    factors = [each.value for pattern, each in stage.lr.items() if fnmatchcase(name, pattern)]
    return not is_frozen(name, stage) and (not factors or factors[-1] != 0.0)
