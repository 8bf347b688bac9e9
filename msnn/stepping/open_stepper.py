"""Opens a stepper: the compiled C code of the model, or the interpreter without a compiler."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import cast

from backends.c.interface.interface import Interface, c_interface
from backends.c_lowering.options import COptions
from backends.files.c_compiler import CompilerMissingError
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning import kernels
from msnn.exports.export import plan_exports
from msnn.exports.prepare import c_options
from msnn.exports.target import ExportPlan
from msnn.model.model import Model
from msnn.simulation.engines.kernel_trials import NO_FALLBACK
from msnn.stepping.engine import StepEngine
from msnn.stepping.stepper import Stepper
from spec_schema.diagnostics.diagnostic import Findings, SpecError, describe
from spec_schema.registry import ARITHMETICS


def open_stepper(model: Model, weights: Mapping[str, FloatArray]) -> Stepper:
    """The model with the options of its C export.

    Without a compiler the interpreter is used, with a RuntimeWarning. Raises SpecError for an
    invalid export, or one in fixed point.
    """
    findings = Findings()
    # the numbers of what `msnn export --to c` writes, slices of 0 left out
    plans = plan_exports(model, ["c"], findings, weights=weights)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    (plan,) = plans
    if plan.dtype in ARITHMETICS:
        raise SpecError([kernels.stepper_of_words(plan.dtype)], model.sources)
    plan = cast("ExportPlan[COptions]", plan)
    weights = plan.of(weights)
    interface = c_interface(plan.program, c_options(plan))
    engine: StepEngine
    try:
        # jinja2 and the emitter are loaded only where something is compiled
        from backends.native.native_step import NativeStep

        engine = NativeStep(plan.program, interface, weights)
    except CompilerMissingError as error:
        engine = _interpreted(str(error), plan.program, interface, weights)
    # a mistake of the emitter must not end a control loop in Python; the warning asks to report it
    except Exception as error:
        if os.environ.get(NO_FALLBACK):
            raise
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
        engine = _interpreted(reason, plan.program, interface, weights)
    return Stepper(engine, interface, model.name, model.program.sample_time)


def _interpreted(
    reason: str, program: Program, interface: Interface, weights: Mapping[str, FloatArray]
) -> StepEngine:
    from backends.c.host.interpreted_step import InterpretedStep

    said = describe(kernels.interpreted_instead(reason))
    # shown at the line of the user's script that opened it
    warnings.warn(said, RuntimeWarning, stacklevel=4)
    return InterpretedStep(program, interface, weights)
