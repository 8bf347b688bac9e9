"""Detects if torchrun, the launcher of torch, has started this process together with others."""

from __future__ import annotations

import os

from msnn.errors.learning.engines import one_process_alone
from spec_schema.diagnostics.diagnostic import SpecError


def is_one_of_several() -> bool:
    """True if torchrun has started this process together with others."""
    started = "TORCHELASTIC_RUN_ID" in os.environ
    return started and int(os.environ.get("WORLD_SIZE", "1")) > 1


def refuse_several_processes() -> None:
    """Raises SpecError under torchrun, for sweeps and comparisons, which do not support it."""
    if is_one_of_several():
        raise SpecError((one_process_alone("a sweep or comparison"),))
