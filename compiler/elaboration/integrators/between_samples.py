"""Reports inputs whose `between` is wrong, has no effect, or should be considered."""

from __future__ import annotations

from compiler.linking.connected import Connected
from compiler.lowering.context import Context
from compiler.lowering.scope import owner_of
from spec_schema.errors import between
from spec_schema.sections.signals import Input


def report_between(context: Context) -> None:
    """Reports mistakes in `between` of the inputs of a lowered spec."""
    _report_closed(context)
    if context.findings.failed:
        return
    later = {name for _, name in context.stage_reads.inputs}
    for name, entry in context.spec.inputs.items():
        # no integrator stage reads it after the sample, so interpolation has no effect
        is_idle = entry.is_linear and name in context.used and name not in later
        if is_idle and not owner_of(name):
            assert entry.between is not None
            context.findings.report(between.nothing_between(name, entry.between.span))
    for name, entry in context.spec.equations.items():
        fed = entry.feeds if isinstance(entry, Connected) else None
        if isinstance(fed, Input) and fed.is_linear:
            assert fed.between is not None
            place = entry.place.key
            context.findings.report(between.held_connection(name, place, fed.between.span))
    if context.spec.train:
        _remark_held(context)


def _report_closed(context: Context) -> None:
    """Reports interpolated inputs that an output predicts: a closed loop lacks their value at
    t+1.
    """
    for output, entry in context.spec.outputs.items():
        if entry.predicts is None:
            continue
        signal = entry.predicts.signal
        fed = context.spec.inputs.get(signal.value)
        if fed is not None and fed.is_linear:
            assert fed.between is not None
            place = fed.between.span
            context.findings.report(
                between.closed_between(signal.value, output, place, signal.span)
            )


def _remark_held(context: Context) -> None:
    """Warns about inputs without `between` in right-hand sides whose parameters are learned."""
    predicted = {o.predicts.signal.value for o in context.spec.outputs.values() if o.predicts}
    open_inputs = {
        name: entry
        for name, entry in context.spec.inputs.items()
        if entry.between is None and name not in predicted and not owner_of(name)
    }
    reads = context.stage_reads
    held = [name for name in open_inputs if ("", name) in reads.inputs]
    learned = [
        name
        for name, entry in context.spec.parameters.items()
        if entry.learn and ("", name) in reads.parameters
    ]
    if held and learned:
        first, *others = (open_inputs[name].place.key for name in held)
        context.findings.report(between.held_inputs(held, learned, first, others))
