"""Chooses the engine of a stage: native kernels where they can be, torch where they cannot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from backends.native.compile_kernel import NoCompilerError
from msnn.data.dataset import FloatArray
from msnn.training.native_engine import NativeEngine, runs_natively
from msnn.training.stage_data import StageData
from msnn.training.stage_plan import StagePlan
from spec_schema.diagnostics import Diagnostic, SpecError
from spec_schema.errors import training as errors

if TYPE_CHECKING:
    from msnn.training.torch_engine import TorchEngine


@dataclass(frozen=True, slots=True)
class OpenedEngine:
    """An engine ready for a stage, and what the user should know of the choice."""

    engine: NativeEngine | TorchEngine
    notes: tuple[Diagnostic, ...]


def open_engine(
    plan: StagePlan,
    series: Mapping[str, FloatArray],
    weights: Mapping[str, FloatArray],
    data: StageData,
) -> OpenedEngine:
    """The engine that the stage asks for; `auto` is native, or torch with the reason said.

    Raises SpecError where `engine: native` cannot be had.
    """
    notes: tuple[Diagnostic, ...] = ()
    arguments = (plan, series, weights, data.train_rows, data.watched_rows)
    if plan.engine != "torch":
        reason = None if runs_natively(plan) else "kernels have no lbfgs"
        if reason is None:
            try:
                return OpenedEngine(NativeEngine(*arguments), ())
            except NoCompilerError as error:
                reason = str(error)
        if plan.engine == "native":
            raise SpecError((errors.no_native_engine(plan.name, reason, plan.span),))
        notes = (errors.torch_instead(plan.name, reason, plan.span),)
    # torch takes seconds to import: only where it trains
    from msnn.training.torch_engine import TorchEngine

    return OpenedEngine(TorchEngine(*arguments), notes)
