"""Makes golden starts: samples around t0, the states that `reset` sets from them, its status."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.status import StatusBit
from backends.c.selftest.vectors.drawn_inputs import DrawnRecord
from backends.c.selftest.vectors.drawn_starts import drawn_starts
from backends.c.selftest.vectors.policy_reference import apply_policy_to_window
from backends.c.selftest.vectors.state_reference import first_state_bits
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class GoldenStart:
    """Arguments and expected results of one `reset`, by name in the spec, in the type of C."""

    windows: dict[str, Array]
    """Raw samples that `reset` takes."""
    supplied: dict[str, Array]
    """States that `reset` takes as arguments."""
    states: dict[str, Array]
    """Expected states after `reset`, (1, *shape)."""
    status: StatusBit
    """The status that `reset` returns."""


def golden_start(
    interface: Interface, interpreter: Interpreter, record: DrawnRecord
) -> GoldenStart:
    """The arguments of `reset` from recorded samples, and the reference interpreter's result."""
    windows: dict[str, Array] = {}
    log, bits = dict(record.log), StatusBit(0)
    for field, port in interface.windows:
        series = log[field.name].copy()
        rows = slice(record.t0 + port.first, record.t0 + port.last + 1)
        windows[field.name] = np.moveaxis(series[rows], 0, -1).reshape(field.shape).copy()
        checked = apply_policy_to_window(port.signal, series[rows], interface.options.dtype)
        # states are computed from the samples after the policy was applied
        series[rows], bits = checked[0], bits | checked[1]
        log[field.name] = series
    states = interpreter.start(log, record.t0)
    return GoldenStart(
        windows=windows,
        supplied={state.name: states[state.name][0] for _, state in interface.supplied},
        states=states,
        status=bits | first_state_bits(interface, states),
    )


def golden_starts(
    program: Program, interface: Interface, weights: Mapping[str, Array], seed: int
) -> list[GoldenStart]:
    """Starts that test each range check of `reset` by its status."""
    options = interface.options
    random = np.random.Generator(np.random.Philox(seed))
    interpreter = Interpreter(program, weights, options.dtype)
    records = drawn_starts(program, random, options.dtype, options.unroll)
    return [golden_start(interface, interpreter, record) for record in records]
