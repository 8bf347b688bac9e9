"""Interpolates an input between two samples for a stage of an integrator (R6)."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from spec_schema.sections.signals import Input


def moving_input(
    context: Context, name: str, entry: Input, environment: Environment
) -> NodeId | None:
    """(1−τ)·u[t] + τ·u[t+1] for `between: linear`; τ is the elapsed fraction of the step.

    Returns None outside the stages of an integrator, and for an input without interpolation. The
    value lies between the two samples, so the range of the input also holds for it.
    """
    stage = environment.stage
    if stage is None or environment.is_elsewhere or not entry.is_linear:
        return None
    builder = context.builder(environment)
    type, fraction = context.type_of(entry), stage.fraction
    if fraction in (0, 1):
        return builder.signal(name, int(fraction), int(fraction), type)
    now, following = (builder.signal(name, at, at, type) for at in (0, 1))
    before = builder.multiply(builder.constant(float(1 - fraction)), now)
    after = builder.multiply(builder.constant(float(fraction)), following)
    interpolated = builder.add(before, after)
    builder.name(interpolated, f"{name}_at_{fraction.numerator}_{fraction.denominator}")
    return interpolated
