"""No argument takes a kernel beyond its tables, and none is cut or shifted out of its range."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.kernel_accuracy.changed_constants import changed_constants
from compiler.kernels.table import KERNELS, routine
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.statements import (
    Assign,
    Block,
    Branch,
    Call,
    Lookup,
    Routine,
    Statement,
)
from tests.kernels.intervals import Interval, NotProvedError, every
from tests.kernels.ranges import prove


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("real", FORMATS)
def test_every_index_is_in_its_table_whatever_the_argument(name: str, real: RealName) -> None:
    right = routine(name, real)
    prove(right, (every(right.format),) * len(right.parameters))


@pytest.mark.parametrize("name", ["exp", "pow", "sinh", "sin"])
@pytest.mark.parametrize("real", FORMATS)
def test_the_last_entry_of_each_table_is_needed(name: str, real: RealName) -> None:
    right = routine(name, real)
    largest = right.format.dtype.type(right.format.largest)
    where = Interval(largest, largest) if name == "sin" else every(right.format)
    assert not _is_proved(replace(right, body=_shorter(right.body)), where)


def test_a_changed_last_digit_that_leaves_the_table_is_found() -> None:
    # the count is rounded by a sum with 1.5 * 2^23: its neighbours make the count one less or more
    right = routine("exp", "float")
    refused = [
        site
        for site, changed in changed_constants(right)
        if not _is_proved(changed, every(right.format))
    ]
    assert 0 < len(refused) < 10, refused


def _is_proved(changed: Routine, where: Interval) -> bool:
    try:
        prove(changed, (where,) * len(changed.parameters))
    except NotProvedError:
        return False
    return True


def _shorter(block: Block) -> Block:
    """With tables that lack their last entry."""
    return replace(block, statements=tuple(map(_with_less, block.statements)))


def _with_less(statement: Statement) -> Statement:
    match statement:
        case Assign(target, Lookup(table, index)):
            return Assign(target, Lookup(replace(table, values=table.values[:-1]), index))
        case Branch(targets, condition, then, otherwise):
            return Branch(targets, condition, _shorter(then), _shorter(otherwise))
        case Call(targets, called, arguments):
            return Call(targets, replace(called, body=_shorter(called.body)), arguments)
        case _:
            return statement
