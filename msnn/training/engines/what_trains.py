"""Checks before data are read that everything needed for training is installed."""

from __future__ import annotations

from collections.abc import Sequence

from backends.files.c_compiler import CompilerMissingError, find_compiler
from msnn.errors.failures import MissingExtraError
from msnn.packages import TORCH, ZIGLANG
from spec_schema.sections.training import Stage

_IN_TORCH = ("msnn.training.engines.torch.torch_engine", "torch._dynamo")
"""Modules imported with the first optimiser: torch then imports its compiler, 900 modules."""


def slow_modules(stages: Sequence[Stage]) -> frozenset[str]:
    """Modules that these stages need and that take seconds to import."""
    in_torch = any(
        stage.engine == "torch" or stage.optimizer.choice.steps_by == "torch" for stage in stages
    )
    return frozenset(_IN_TORCH if in_torch else ())


def require_what_trains(stages: Sequence[Stage]) -> None:
    """Raises MissingExtraError if a stage needs torch or a C compiler and it is not installed."""
    for stage in stages:
        optimizer = stage.optimizer.choice
        if optimizer.steps_by == "torch":
            TORCH.require(f"has {optimizer.noun}")
        if stage.engine == "torch":
            TORCH.require("trains with `engine: torch`")
    try:
        find_compiler()
    except CompilerMissingError as error:
        if not TORCH.is_installed:
            install = f"apt install gcc, or {ZIGLANG.install}, or {TORCH.install}"
            raise MissingExtraError("a C compiler, or torch in its place,", install) from error
