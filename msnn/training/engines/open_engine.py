"""Selects the engine of a stage: native kernels if possible, otherwise torch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from backends.files.c_compiler import CompilerMissingError
from backends.files.disk_arrays import DiskArray
from backends.native.kernel_cache import kernel_folder
from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, FloatArray
from msnn.errors.data.files import not_on_disk
from msnn.errors.learning import training as errors
from msnn.errors.learning.engines import no_ranks_in_torch
from msnn.packages import TORCH
from msnn.simulation.engines.open_rollouts import kernel_folder_warnings
from msnn.training.engines.devices import installed_memory, memory_warnings
from msnn.training.engines.native.native_engine import NativeEngine, on_torch, try_natively
from msnn.training.engines.native.native_squares import NativeSquares
from msnn.training.engines.second_order.levenberg_marquardt import LevenbergMarquardtEngine
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.sections.optimizers import TorchOptimizer

if TYPE_CHECKING:
    from msnn.training.engines.torch.torch_engine import TorchEngine

    AnyEngine = NativeEngine | TorchEngine | LevenbergMarquardtEngine

RowsByLoss = Mapping[str, BoolArray]
EngineArguments = tuple[
    StagePlan,
    Mapping[str, FloatArray],
    Mapping[str, FloatArray],
    RowsByLoss | None,
    RowsByLoss | None,
]


@dataclass(frozen=True, slots=True)
class OpenedEngine:
    """An engine that is ready to train a stage, with diagnostics if it is not the requested one."""

    engine: AnyEngine
    plan: StagePlan
    """The stage as the engine runs it."""
    notes: tuple[Diagnostic, ...]


def try_optimizers(program: Program, plans: Iterable[StagePlan]) -> None:
    """Constructs the optimisers of torch that the stages use, before the training begins.

    Raises SpecError with the errors that torch reports, such as an unknown option.
    """
    findings = Findings()
    for plan in plans:
        if isinstance(plan.optimizer, TorchOptimizer):
            from msnn.training.engines.torch.torch_optimizers import try_torch_optimizer

            trained = [program.parameter(name) for name in plan.trained]
            try_torch_optimizer(plan.optimizer, plan.weight_decay, trained, findings)
    findings.raise_errors()


def open_engine(
    plan: StagePlan,
    series: Mapping[str, FloatArray],
    weights: Mapping[str, FloatArray],
    data: StageData,
) -> OpenedEngine:
    """Builds the engine of a stage and checks its kernels against the reference interpreter.

    `engine: auto` selects native kernels; torch, with a note that gives the reason, if they fail.
    `series` are the data (rows, *shape), `weights` the initial parameters. Raises SpecError if
    `engine: native` is not possible.
    """
    given = (series, weights, data.train_rows, data.watched_rows)
    notes: tuple[Diagnostic, ...] = ()
    if plan.engine != "torch":

        def native(as_it_runs: StagePlan) -> AnyEngine:
            engine = _native((as_it_runs, *given))
            # compare with the reference interpreter: a wrong kernel must not produce a wrong model
            engine.check(data.train)
            return engine

        squares = plan.optimizer.needs_squares  # float64 in any case
        try:
            tried = try_natively(plan, native, in_double=not squares)
            if tried.made is not None:
                kept = kernel_folder_warnings(kernel_folder())
                return OpenedEngine(tried.made, tried.plan, (*kept, *tried.notes))
            plan, notes = tried.plan, tried.notes
        except CompilerMissingError as error:
            if plan.engine == "native":
                found = errors.no_native_engine(plan.name, str(error), plan.span)
                raise SpecError((found,)) from None
            plan, notes = on_torch(plan), (errors.torch_instead(plan.name, str(error), plan.span),)
    # every rank has to sum in the same order, which torch does not promise
    if plan.ranks is not None:
        reasons = (note.message for note in notes)
        raise SpecError((no_ranks_in_torch(plan.name, plan.span, tuple(reasons)),))
    if any(isinstance(values, DiskArray) for values in series.values()):
        reason = f"stage `{plan.name}` runs in torch, which takes all rows into memory"
        why = tuple(note.message for note in notes)
        raise SpecError((not_on_disk(reason, plan.span, why=why),))
    for note in notes:  # kernels could not be had, or were wrong: torch is what is left
        TORCH.require(f"must train instead ({note.message})")
    arguments = (plan, *given)
    # torch takes seconds to import: only where it trains
    if plan.optimizer.needs_squares:
        from msnn.training.engines.torch.torch_squares import TorchSquares

        return OpenedEngine(LevenbergMarquardtEngine(*arguments, TorchSquares), plan, notes)
    from msnn.training.engines.torch.torch_engine import TorchEngine

    notes += memory_warnings(plan, data.train, installed_memory())
    return OpenedEngine(TorchEngine(*arguments), plan, notes)


def _native(arguments: EngineArguments) -> AnyEngine:
    """The engine with kernels for the stage's optimiser.

    A second-order optimiser uses residuals and Jacobians of kernels. Adam and similar ones run in
    the kernel. Other optimisers are those of torch, with gradients of the kernel.
    """
    optimizer = arguments[0].optimizer
    if optimizer.needs_squares:
        return LevenbergMarquardtEngine(*arguments, NativeSquares)
    if optimizer.steps_by == "kernel":
        return NativeEngine(*arguments)
    from msnn.training.engines.torch.objectives import KernelObjective
    from msnn.training.engines.torch.torch_engine import TorchEngine

    return TorchEngine(*arguments, KernelObjective)
