"""`savitzky_golay`: a smoothed value or derivative, by a polynomial fitted to a time window."""

from __future__ import annotations

import math

import numpy as np

from compiler.ir.program import NodeId
from compiler.ir.scalars import Array
from compiler.ir.types import WINDOW, Axis
from compiler.layers.rules.arguments import read_window
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.errors import names
from spec_schema.sections.layer_kinds import SavitzkyGolay
from spec_schema.units.parser import parse_unit


def savitzky_golay(context: LayerContext, settings: SavitzkyGolay, arguments: Arguments) -> NodeId:
    """y = dᵐp/dtᵐ at t − lag, where p is the polynomial of degree `order` with the least squared
    error to the window's samples.

    All samples weigh equally, so y is a fixed weighted sum of them (Savitzky and Golay 1964). It
    has no learned arrays and no initial transient; each element of a vector has its own.
    `derivative` is m, 0 smooths. `lag`, in samples or as a duration, is 0 for an estimate at t, and
    half the window for the lowest noise. The unit is that of x over sᵐ.
    """
    (window,) = arguments
    builder = context.builder
    samples, dt = builder.type(window).window, context.lowering.sampling.sample_time
    assert samples is not None
    assert dt is not None, "there are no windows without a sample time"
    lag = context.lowering.sampling.samples(settings.lag) if settings.lag is not None else 0
    derivative, order = settings.derivative, settings.order
    problem: str | None = None
    if order >= samples:
        problem = (
            f"a polynomial of order {order} needs {order + 1} samples, the window has {samples}"
        )
    elif derivative > order:
        problem = f"derivative {derivative} of a polynomial of order {order} is always 0"
    elif lag >= samples:
        problem = f"a lag of {lag} samples lies before the window of {samples}"
    if problem is not None:
        place = settings.place.key
        context.refuse(names.unfit_setting(f"`{context.name}`", problem, place))
    unit = parse_unit("s").power(-derivative)
    weights = _weights(samples, order, derivative, lag) / dt**derivative
    taps = builder.constant(weights, (Axis(WINDOW, samples),), unit)
    return builder.contract_over(taps, window, WINDOW)


def _weights(samples: int, order: int, derivative: int, lag: int) -> Array:
    """The weight of each sample of the window, for derivative m of a polynomial of degree `order`,
    with 1 sample as the unit of time: m! times row m of the pseudo-inverse of the matrix of powers
    of time. Time 0 is t − lag.
    """
    reach = max(samples - 1, 1)  # powers of at most 1 keep the fit well conditioned
    times = (np.arange(samples) - (samples - 1 - lag)) / reach
    fit = np.linalg.pinv(np.vander(times, order + 1, increasing=True))
    return math.factorial(derivative) * fit[derivative] / float(reach) ** derivative


SAVITZKY_GOLAY = LayerRule(SavitzkyGolay, read_window, savitzky_golay)
