"""Prepares a model for most targets: loops closed, unused outputs removed, in step form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from backends.c_lowering.options import COptions
from backends.ports.identifiers import c_identifier
from compiler.ir.nodes import extents
from compiler.ir.program import Program
from compiler.passes.close_loop import LoopError, close_loop
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.errors import workflow
from msnn.exports.target import ExportPlan, Options, OwnEntry, Request, Target
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import between
from spec_schema.errors.states import not_closable
from spec_schema.fields.leaf import Located
from spec_schema.sections.exports import FloatTargetEntry, TargetEntry

MOST_ENTRIES = 250_000
"""Maximum number of entries in a Jacobian matrix: a megabyte in single precision."""


def float_plan(
    target: Target[OwnEntry, Options],
    request: Request,
    entry: FloatTargetEntry | None,
    prefix: Located[str] | None = None,
) -> ExportPlan[Options] | None:
    """The plan of an export in floating point; None if a loop of the model cannot be closed.

    `prefix` begins the public names of the files.
    """
    step = step_program(request, entry)
    if step is None:
        return None
    return ExportPlan(
        target=target,
        program=step,
        prefix=name_prefix(request, prefix),
        dtype=target.dtype if entry is None or entry.dtype is None else entry.dtype,
        options=target.options,
    )


def name_prefix(request: Request, given: Located[str] | None) -> str:
    """The prefix of an export's public names: the given one, or the name of the model."""
    return c_identifier(request.model.name if given is None else given.value, set())


def c_options(plan: ExportPlan[COptions]) -> COptions:
    """The options of a C plan, with its number format and prefix."""
    return replace(plan.options, dtype=plan.float_type, prefix=plan.prefix)


def step_program(
    request: Request,
    entry: TargetEntry | None,
    delay: Sequence[Located[str]] = (),
    *,
    keeps_arrays: bool = False,
) -> Program | None:
    """The model's program with closed loops, reduced to the outputs of the entry.

    It is delayed by the number of samples that it reads ahead of the inputs in `delay`. Zero slices
    of penalised arrays are omitted, unless `keeps_arrays` because callers use their shapes. None if
    a loop cannot be closed; errors in the entry are reported.
    """
    program = _closed(request, entry)
    if program is None:
        return None
    # before losses are pruned; only penalties make exact zeros that mean "not needed"
    penalised = {loss.penalty.parameter for loss in program.losses if loss.penalty is not None}
    program = prune_outputs(program, _outputs(request, entry))
    if request.weights is not None and penalised and not keeps_arrays:
        from compiler.passes.prune_zero_slices import (
            prune_zero_slices,  # `check` has no weights
        )

        pruned = prune_zero_slices(program, request.weights, penalised)
        request.cuts.extend(pruned.cuts)
        program = pruned.program
    return to_step_form(program, _late(request, program, delay))


def _late(request: Request, program: Program, delay: Sequence[Located[str]]) -> int:
    """The number of samples by which an export must be late: the maximum preview of inputs in
    `delay`.
    """
    if not delay:
        return 0
    # `delay:` of an input that is not read ahead would make the step late for nothing
    ahead = {n: e.last for n, e in extents(program.step, log=False).items() if e.last > 0}
    for name in delay:
        if name.value not in ahead:
            fault = between.needless_delay(name.value, name.span, tuple(ahead))
            request.findings.report(fault)
    return max((ahead.get(name.value, 0) for name in delay), default=0)


def loop_fault(error: LoopError, place: Span | None) -> Diagnostic:
    """The diagnostic for a signal that cannot be fed back, at the request or at the cause."""
    return not_closable(error.signal, place or error.span, error.reason)


def _closed(request: Request, entry: TargetEntry | None) -> Program | None:
    if entry is None:
        return request.model.program
    try:
        return close_loop(request.model.program, [name.value for name in entry.close])
    except LoopError as error:
        place = next((name.span for name in entry.close if name.value == error.signal), None)
        request.findings.report(loop_fault(error, place))
        return None


def _outputs(request: Request, entry: TargetEntry | None) -> list[str]:
    """The names of a target's outputs; equations only if its entry names them."""
    model = request.model
    known = [output.name for output in model.program.outputs]
    if entry is None or entry.outputs is None:
        # equations that other targets name are outputs of the program, too (decision 0105)
        return [name for name in known if name in model.spec.outputs]
    unknown = [name for name in entry.outputs if name.value not in known]
    request.findings.report(*(workflow.unknown_output(n.value, n.span, known) for n in unknown))
    return [name.value for name in entry.outputs if name.value in known]
