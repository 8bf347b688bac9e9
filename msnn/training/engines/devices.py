"""Chooses where torch computes, and checks that its packages are installed and memory suffices."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.files.c_compiler import CompilerMissingError, find_compiler
from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.program import Program
from msnn.data.rollout_rows import Runs
from msnn.errors.failures import MissingExtraError
from msnn.errors.learning.engines import no_kernel_on_card, no_such_card, unknown_device
from msnn.errors.learning.stages import much_memory
from msnn.packages import TORCH, ZIGLANG
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.sections.training import Stage

_NAME = re.compile(r"cpu|auto|cuda(?::(?P<card>0|[1-9]\d{0,3}))?")


@dataclass(frozen=True, slots=True)
class Device:
    """A device for stages on torch, by torch's name: `cpu`, `cuda`, `cuda:1`."""

    torch: str
    for_all: bool
    """True if stages with `engine: auto` run on this device too, instead of by native kernels."""

    @property
    def name(self) -> str:
        """The text that the user writes for this device: `cpu`, `cuda:1`, or `auto` if torch stages
        alone use it.

        `find_device` returns the same device for it.
        """
        return self.torch if self.for_all or self.torch == "cpu" else "auto"


CPU = Device("cpu", for_all=False)


def find_device(name: str) -> Device:
    """The device for `cpu`, `cuda`, `cuda:N` or `auto`; `auto` is CUDA if torch can use it, else
    CPU.

    Raises SpecError for an unknown name or a missing card, and MissingExtraError without CUDA.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        raise SpecError((unknown_device(name),))
    if name == "cpu":
        return CPU
    if name == "auto" and not TORCH.is_installed:
        return CPU
    TORCH.require("computes on graphics cards")
    # it takes seconds to import: only where somebody asks for more than the CPU
    import torch

    cards = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == "auto":
        return Device("cuda", for_all=False) if cards else CPU
    if not cards:
        raise MissingExtraError("CUDA that torch can use", _remedy(torch.version.cuda))
    card = match["card"]
    if card is not None and int(card) >= cards:
        raise SpecError((no_such_card(name, cards),))
    return Device(name, for_all=True)


def on_device(plans: Sequence[StagePlan], device: Device, findings: Findings) -> list[StagePlan]:
    """Moves stages to a device, where torch then computes them: all if the device was named, else
    torch stages.

    Warns about each stage with `engine: native` that moves, because native kernels run on the CPU
    only.
    """
    if device.torch == "cpu":
        return list(plans)
    placed: list[StagePlan] = []
    for plan in plans:
        if device.for_all and plan.engine == "native":
            findings.report(no_kernel_on_card(plan.name, device.torch, plan.span))
        moves = device.for_all or plan.engine == "torch"
        placed.append(replace(plan, engine="torch", device=device.torch) if moves else plan)
    return placed


def _remedy(built_for: str | None) -> str:
    if built_for is None:
        return "this torch is built for the CPU alone: install one for CUDA, or `--device cpu`"
    return (
        f"torch is built for CUDA {built_for} but finds no card: see `nvidia-smi`, or "
        "`--device cpu`"
    )


_IN_TORCH = ("msnn.training.engines.torch.torch_engine", "torch._dynamo")
"""Modules imported with the first optimiser: torch then imports its compiler, 900 modules."""


def slow_modules(stages: Sequence[Stage]) -> frozenset[str]:
    """Names of modules that these stages import and that take seconds: those of torch, or none."""
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


_SHARE = 0.5
"""Fraction of the installed memory above which a warning precedes the stage."""


@dataclass(frozen=True, slots=True)
class Needed:
    """An estimate of the memory for one batch in torch: start rows × steps × bytes per step."""

    starts: int
    steps: int
    step_bytes: int

    @property
    def total(self) -> int:
        return self.starts * self.steps * self.step_bytes


def memory_warnings(plan: StagePlan, runs: Runs, installed: int | None) -> tuple[Diagnostic, ...]:
    """Warns if a stage on torch needs more than half of the installed memory.

    Kernels cut long rollouts into pieces that fit (`KEPT_BYTES`), and least squares process the
    start rows in portions. torch keeps the values of every step until the gradient is computed.
    """
    needed = needed_by_torch(plan, runs)
    if installed is None or needed.total <= _SHARE * installed:
        return ()
    return (
        much_memory(
            stage=plan.name,
            starts=needed.starts,
            steps=needed.steps,
            step_bytes=needed.step_bytes,
            installed=installed,
            span=plan.span,
        ),
    )


def needed_by_torch(plan: StagePlan, runs: Runs) -> Needed:
    """Estimates the values of all operations of a step, for each start row and step of a batch.

    Views, such as windows and reshapes, and values that depend on parameters only are not counted.
    The measured memory is 0.5 to 0.9 of this, more for longer rollouts.
    """
    starts = len(runs) if plan.batch is None else min(plan.batch, len(runs))
    steps = int(np.max(runs.steps, initial=0))
    size = np.dtype(plan.dtype).itemsize
    return Needed(starts, steps, size * _values(plan.program))


def installed_memory() -> int | None:
    """The size of the machine's RAM in bytes; None if the operating system does not report it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def _values(program: Program) -> int:
    """Number of elements that a step computes for each start row: elementwise values, windows,
    sums.
    """
    graph = program.step
    wanted = [state.next for state in program.states]
    wanted += [loss.prediction for loss in program.losses]
    live = needed(graph, wanted)
    fixed: list[bool] = []
    for _, node in graph:
        match node.op:
            case ops.Constant() | ops.ReadParameter():
                fixed.append(True)
            case ops.Leaf() | ops.Window():
                fixed.append(False)
            case _:
                fixed.append(all(fixed[arg] for arg in node.args))
    return sum(
        node.type.size
        for index, (_, node) in enumerate(graph)
        if live[index] and not fixed[index] and not isinstance(node.op, ops.Leaf | ops.Structure)
    )
