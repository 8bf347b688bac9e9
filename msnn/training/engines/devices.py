"""Chooses where torch computes: on the CPU, or on a graphics card through CUDA."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from msnn.errors.failures import MissingExtraError
from msnn.errors.learning.devices import no_kernel_on_card, no_such_card, unknown_device
from msnn.packages import TORCH
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Findings, SpecError

_NAME = re.compile(r"cpu|auto|cuda(?::(?P<card>0|[1-9]\d{0,3}))?")


@dataclass(frozen=True, slots=True)
class Device:
    """A device for stages on torch, by torch's name: `cpu`, `cuda`, `cuda:1`."""

    torch: str
    for_all: bool
    """True if stages with `engine: auto` run on this device too, instead of by native kernels."""

    @property
    def name(self) -> str:
        """The argument with which `find_device` returns this device."""
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
    """The stages with their device; reports stages with `engine: native`, which stay on the CPU."""
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
