"""Joins a command with other processes started by torchrun; only one prints messages."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from msnn.cli.output_options import NOW
from msnn.packages import TORCH
from msnn.training.ranks.torchrun import is_one_of_several
from spec_schema.diagnostics.diagnostic import SpecError

if TYPE_CHECKING:
    from msnn.training.ranks.gloo_ranks import GlooRanks


@contextmanager
def joined_ranks() -> Generator[GlooRanks | None]:
    """A context with the processes that torchrun has started for one training; None without
    torchrun.

    Only the first process shows progress. An error is printed by the process that meets it first.
    Raises MissingExtraError without torch.
    """
    # found in the environment that torchrun sets, so that a command on its own never loads torch
    # here
    if not is_one_of_several():
        yield None
        return
    TORCH.require("lets processes train together")
    from msnn.training.ranks.gloo_ranks import GlooRanks

    ranks = GlooRanks()
    NOW.is_silent = not ranks.is_first
    try:
        yield ranks
    except BaseException as error:
        # torchrun ends the others soon: what there is to say is said before
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        # one process alone tells it: several messages of one mistake would be mixed line by line
        speaks = ranks.is_speaker() or (ranks.is_first and _is_of_lost_rank(error))
        NOW.is_silent = not speaks
        raise


def _is_of_lost_rank(error: BaseException) -> bool:
    """True if the error is E0867: another process was lost, and the message says where the training
    is saved. Only the first process knows that place.
    """
    return isinstance(error, SpecError) and any(d.code == "E0867" for d in error.diagnostics)


def speak_once() -> None:
    """Lets only the first process print errors, for commands that do not support several
    processes.
    """
    if is_one_of_several():
        # torchrun ends the others soon: what there is to say is said before
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        # by the environment, as the processes have not joined: what fails before that fails in all
        # alike
        NOW.is_silent = os.environ.get("RANK") != "0"
