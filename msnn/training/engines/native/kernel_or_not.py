"""Tries native kernels, and selects a fallback if a kernel is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from backends.files.c_compiler import CompilerMissingError
from backends.native.sensitivity_kernel import StackTooSmallError
from msnn.errors.learning import kernels
from msnn.errors.learning import training as errors
from msnn.simulation.engines.kernel_trials import NO_FALLBACK, WrongKernelError
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Attempt(Generic[Made]):
    """The kernels of a stage; None if torch is needed, with the reasons."""

    made: Made | None
    plan: StagePlan
    """The stage as it will run."""
    notes: tuple[Diagnostic, ...]


def try_natively(
    plan: StagePlan, make: Callable[[StagePlan], Made], *, in_double: bool
) -> Attempt[Made]:
    """Builds and checks kernels; if they are wrong in float32, tries float64 if `in_double`.

    A wrong kernel never ends a training: it is reported, and the stage uses the fallback. Raises
    CompilerMissingError, and SpecError if `engine: native` is not possible.
    """
    try:
        return Attempt(make(plan), plan, ())
    # not a wrong kernel: the caller handles a missing compiler
    except (CompilerMissingError, SpecError):
        raise
    except WrongKernelError as error:
        _raise_if_asked(error)
        if in_double and plan.dtype == "float32":
            note = kernels.wrong_kernel(plan.name, str(error), "in float64", plan.span)
            # at most once, as float64 has no wider type to go on to
            other = try_natively(replace(plan, dtype="float64"), make, in_double=False)
            resolved = on_torch(plan) if other.made is None else other.plan
            return Attempt(other.made, resolved, (note, *other.notes))
        note = kernels.wrong_kernel(plan.name, str(error), "with torch", plan.span)
    except StackTooSmallError as error:
        reason = str(error)
        if plan.engine == "native":
            raise SpecError((errors.no_native_engine(plan.name, reason, plan.span),)) from error
        note = kernels.kernel_not_made(plan.name, reason, plan.span, too_large=True)
    except Exception as error:
        _raise_if_asked(error)
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
        if plan.engine == "native":
            raise SpecError((errors.no_native_engine(plan.name, reason, plan.span),)) from error
        note = kernels.kernel_not_made(plan.name, reason, plan.span)
    return Attempt(None, on_torch(plan), (note,))


def on_torch(plan: StagePlan) -> StagePlan:
    """The same stage without kernels."""
    return replace(plan, engine="torch")


def _raise_if_asked(error: Exception) -> None:
    if os.environ.get(NO_FALLBACK):
        raise error
