"""The section `budget`: limits the number of operations of a step."""

from dataclasses import dataclass
from typing import ClassVar

from msnn.extending import (
    CompiledSection,
    CompileOther,
    Entry,
    Linked,
    PositiveCount,
    Program,
    Section,
    SpecError,
    error,
)


class Budget(Entry):
    """The work that one step may be."""

    noun: ClassVar[str] = "the budget"
    operations: PositiveCount
    """The largest number of operations of a step, as `msnn show --program` lists them."""


@dataclass(frozen=True)
class Work:
    """The compiled section: the program that it measures, and the limit."""

    program: Program
    limit: int


def _compile(
    entry: Budget, linked: Linked, program: Program, compile_other: CompileOther
) -> CompiledSection[Work]:
    work = Work(program, entry.operations)
    found = len(program.step.nodes)
    if found > work.limit:
        message = f"a step has {found} operations, and the budget is {work.limit}"
        repair = "raise `operations`, or simplify the model"
        raise SpecError([error("X0001", entry.place.value, message, "too few", help=repair)])
    return CompiledSection(work)


def _text(work: Work) -> str:
    return f"budget: {len(work.program.step.nodes)} of {work.limit} operations"


BUDGET = Section(compile=_compile, text=_text)
