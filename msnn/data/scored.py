"""Finds the evaluations that count by their rows: those whose targets are rows that do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.ir.liveness import Extent
from compiler.ir.program import Graph, Loss, Program
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.reads import reads, span


def rows_that_count(
    dataset: Dataset, name: str | None, extent: Extent, skip_rows: int = 0
) -> BoolArray:
    """For every row t whether all of t+first … t+last belong to the set, any for None.

    The first `skip_rows` rows of each record do not count.
    """
    member = np.ones(dataset.rows, dtype=np.bool_) if name is None else dataset.in_set(name)
    for record in dataset.records if skip_rows else ():
        member[record.start : min(record.start + skip_rows, record.stop)] = False
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
    """For every loss of the program the rows t at which its target counts."""
    return {
        loss.name: rows_that_count(dataset, name, target_extent(program.step, loss), skip_rows)
        for loss in program.losses
    }


def target_extent(step: Graph, loss: Loss) -> Extent:
    """The samples around t that the target of a loss reads; t itself where there is none."""
    if loss.target is None:
        return Extent(0, 0)
    return span(reads(step, [loss.target]).values()) or Extent(0, 0)
