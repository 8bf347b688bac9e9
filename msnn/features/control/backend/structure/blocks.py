"""Tabulates the blocks of a horizon (move blocking): samples over which controls stay constant."""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import block_starts, previous_places
from msnn.features.control.problem.optimal_control.problem import ControlProblem


def block_tables(problem: ControlProblem) -> dict[str, object]:
    """Returns index tables for the templates; `held` is False if every block is one sample."""
    if not problem.has_blocks:
        return {"held": False}
    # block_starts is True at the first stage of each block: its sum counts the blocks
    block = np.cumsum(block_starts(problem)) - 1
    decided = (0, *((block + 1) * problem.controls.size).tolist())
    return {
        "held": True,
        "blocks": len(problem.blocks),
        "longest_block": max(problem.blocks),
        "block_of_stage": block.tolist(),
        "block_begins": np.cumsum((0, *problem.blocks)).tolist(),
        "decided_before": list(decided),
        "latest": previous_places(problem).tolist(),
    }
