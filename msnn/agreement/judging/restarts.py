"""Resets states with `on_range: reset` to their initial values, like deployed code."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike, NDArray

from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Arrays


def outside(program: Program, states: Arrays, dtype: DTypeLike) -> dict[str, NDArray[np.bool_]]:
    """Masks (steps,) of steps at which a state with `on_range: reset` is outside its range or NaN.

    Limits are rounded to the dtype of the deployed code.
    """
    found: dict[str, NDArray[np.bool_]] = {}
    for state in program.states:
        if state.on_range == "reset" and state.range is not None:
            low, high = np.asarray(state.range, dtype)
            values = states[state.name].reshape(len(states[state.name]), -1)
            found[state.name] = ~np.all((values >= low) & (values <= high), axis=1)
    return found


def begun_again(states: Arrays, at: Mapping[str, NDArray[np.bool_]], first: Arrays) -> Arrays:
    """The states, with their initial values (1, *shape) at these steps."""
    found = dict(states)
    for name, steps in at.items():
        values = np.array(states[name])
        values[steps] = first[name]
        found[name] = values
    return found
