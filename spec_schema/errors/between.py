"""E0226-E0227, W0745, W0747-W0748: inputs between their samples."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, remark, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def closed_between(name: str, output: str, span: Span, prediction: Span) -> Diagnostic:
    """E0226: `between: linear` for an input that is fed back from an output."""
    message = f"`{name}` cannot be linear between samples: `{output}` predicts it"
    return error(
        "E0226",
        span,
        message,
        "reads the sample at t+1, which is not known yet",
        secondary=((prediction, "fed back from here"),),
        help="write `between: hold`, or make it a state if it is one",
    )


def needless_delay(name: str, span: Span, known: Sequence[str]) -> Diagnostic:
    """E0227: a `delay` for an input of which the exported step reads no future samples."""
    message = f"`delay` names `{name}`, which the exported step does not read ahead"
    meant = nearest(name, known)
    repair, label = did_you_mean(meant) or "leave `delay` out", "has no sample to wait for"
    return error("E0227", span, message, label, help=repair, replacement=meant)


def nothing_between(name: str, span: Span) -> Diagnostic:
    """W0745: `between: linear` for an input that is only read at its samples."""
    message = f"`between: linear` of `{name}` changes nothing"
    reason = "`euler` and `semi_implicit` evaluate right-hand sides where a substep begins"
    others = "what is not read by `der:` sees samples"
    repair = "leave it out, or take another integrator or more substeps"
    label = "no right-hand side reads it after sample t"
    return warning("W0745", span, message, label, notes=(reason, others), help=repair)


def held_connection(name: str, span: Span, between: Span) -> Diagnostic:
    """W0747: `between: linear` for a connected input of a sub-model."""
    message = f"`{name}` is held from sample to sample: it is connected"
    return warning(
        "W0747",
        span,
        message,
        "a sample of the expression feeds each step",
        secondary=((between, "its file says otherwise"),),
        notes=("what a connection gives at t+1 is not known at t",),
        help="write `between: hold` in the file of the sub-model if its input is held in use",
    )


def held_inputs(
    inputs: Sequence[str], parameters: Sequence[str], span: Span, others: Sequence[Span]
) -> Diagnostic:
    """W0748: inputs held between samples by default, while parameters of `der:` are learned."""
    is_held, is_learned = (
        f"{_listed(names)} {'is' if len(names) == 1 else 'are'}" for names in (inputs, parameters)
    )
    # a remark with its reason, not a fault: where inputs come from a hold circuit holding is right
    bias = "a held signal is half a sample late, and learned values make up for it, damping first"
    repair = "write `between: linear` where it samples a continuous signal, else `between: hold`"
    return remark(
        "W0748",
        span,
        f"{is_held} held between samples while {is_learned} learned in right-hand sides",
        "`between` is not given",
        secondary=tuple((other, "nor here") for other in others),
        notes=(bias,),
        help=repair,
    )


def _listed(names: Sequence[str]) -> str:
    """Names as a text such as "`a`, `b`, `c` and 2 more"."""
    # more names would push the sentence out of its line, and each has its place below
    most = 3
    shown = ", ".join(f"`{name}`" for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
