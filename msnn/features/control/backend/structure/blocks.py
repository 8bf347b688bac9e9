"""Lists where the blocks of a horizon are, over which controls stay the same."""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import block_starts, previous_places
from msnn.features.control.problem.optimal_control.problem import ControlProblem


def block_tables(problem: ControlProblem) -> dict[str, object]:
    """Tables for the templates; `held` is whether any block has more than one sample."""
    if not problem.has_blocks:
        return {"held": False}
    # block_starts counts up by one at the first stage of each block
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
