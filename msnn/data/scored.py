"""Selects the evaluations that contribute to losses: all rows of their targets must be usable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from compiler.ir.nodes import Extent
from compiler.ir.program import Graph, Loss, Program
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.reads import reads, span


def rows_that_count(
    dataset: Dataset,
    name: str | None,
    extent: Extent,
    skip_rows: int = 0,
    measured: Iterable[BoolArray] = (),
) -> BoolArray:
    """Mask of rows t for which all rows t+first … t+last belong to the set (None: any set).

    The first `skip_rows` rows of each recording are excluded, and rows that are false in one of the
    `measured` masks.
    """
    member = np.ones(dataset.rows, dtype=np.bool_) if name is None else dataset.in_set(name)
    for record in dataset.records if skip_rows else ():
        member[record.start : min(record.start + skip_rows, record.stop)] = False
    for rows in measured:
        member &= rows
    found = np.ones(len(member), dtype=np.bool_)
    # shifted and joined: windows of targets are short, rows are many
    for offset in range(extent.first, extent.last + 1):
        shifted = np.zeros(len(member), dtype=np.bool_)
        source = member[max(offset, 0) : len(member) + min(offset, 0)]
        shifted[max(-offset, 0) : max(-offset, 0) + len(source)] = source
        found &= shifted
    return found


def scored_rows(
    dataset: Dataset, name: str | None, program: Program, skip_rows: int = 0
) -> Mapping[str, BoolArray]:
    """For every loss of the program, the mask of rows t at which its target counts."""
    return {
        loss.name: rows_that_count(
            dataset,
            name,
            target_extent(program.step, loss),
            skip_rows,
            (dataset.measured[signal] for signal in _lacking(dataset, program.step, loss)),
        )
        for loss in program.losses
    }


def has_unmeasured(dataset: Dataset, program: Program) -> bool:
    """True if a loss of the program uses a target row without a measured value."""
    return any(_lacking(dataset, program.step, loss) for loss in program.losses)


def _lacking(dataset: Dataset, step: Graph, loss: Loss) -> list[str]:
    """The signals read by a loss's target that have no measured value in some rows.

    Empty for a target that reads several rows, such as a derivative: it also uses interpolated
    values.
    """
    if loss.target is None or not dataset.measured:
        return []
    found = reads(step, [loss.target])
    around = span(found.values())
    if around is None or around.first != around.last:
        return []
    return [signal for signal in found if signal in dataset.measured]


def target_extent(step: Graph, loss: Loss) -> Extent:
    """The samples relative to t that the target of a loss reads; t itself if there is no target."""
    if loss.target is None:
        return Extent(0, 0)
    return span(reads(step, [loss.target]).values()) or Extent(0, 0)
