"""Tries native kernels, and says what to go on with where msnn itself made a mistake."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from backends.files.c_compiler import CompilerMissingError
from backends.native.rollouts.sensitivity_kernel import StackTooSmallError
from msnn.errors.learning import kernels
from msnn.errors.learning import training as errors
from msnn.simulation.engines.kernel_trials import NO_FALLBACK, WrongKernelError
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Attempt(Generic[Made]):
    """A stage's kernels; None where torch must do, with the reasons."""

    made: Made | None
    plan: StagePlan
    """The stage as it runs."""
    notes: tuple[Diagnostic, ...]


def try_natively(
    plan: StagePlan, make: Callable[[StagePlan], Made], *, in_double: bool
) -> Attempt[Made]:
    """Makes and checks kernels; where these are wrong in float32, those `in_double` if wanted.

    Nobody's training is lost by a mistake of ours: it is said and the stage goes on without.
    Raises CompilerMissingError, and SpecError where `engine: native` cannot be had.
    """
    try:
        return Attempt(make(plan), plan, ())
    # no mistake of ours: the caller says what a missing compiler means
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
