"""Takes states with `on_range: reset` back to where they began, as deployed code does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike, NDArray

from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Arrays


def outside(program: Program, states: Arrays, dtype: DTypeLike) -> dict[str, NDArray[np.bool_]]:
    """At which steps a state with `on_range: reset` is outside, NaN too: (steps,) each.

    Limits are rounded to the type that the code computes in.
    """
    found: dict[str, NDArray[np.bool_]] = {}
    for state in program.states:
        if state.on_range == "reset" and state.range is not None:
            low, high = np.asarray(state.range, dtype)
            values = states[state.name].reshape(len(states[state.name]), -1)
            found[state.name] = ~np.all((values >= low) & (values <= high), axis=1)
    return found


def begun_again(states: Arrays, at: Mapping[str, NDArray[np.bool_]], first: Arrays) -> Arrays:
    """The states, at these steps as they were before the first one (1, *shape)."""
    found = dict(states)
    for name, steps in at.items():
        values = np.array(states[name])
        values[steps] = first[name]
        found[name] = values
    return found
