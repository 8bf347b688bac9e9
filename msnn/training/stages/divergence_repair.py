"""Selects the repair of a diverged training by the origin of its first non-finite value."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.ir import ops
from compiler.ir.program import Node, Program

_IN_DOMAIN: Mapping[str, str] = {
    "sqrt": "`sqrt(max(x, 0))` for `sqrt(x)`: x falls below 0 there",
    "log": "`log(max(x, 1e-9))` for `log(x)`: x is not above 0 there",
    "asin": "`asin(clip(x, -1, 1))` for `asin(x)`: x leaves [-1, 1] there",
    "acos": "`acos(clip(x, -1, 1))` for `acos(x)`: x leaves [-1, 1] there",
    "pow": "`max(x, 0) ** p` for `x ** p`: x falls below 0 there",
}
"""Functions with a limited domain, and a formula that stays within it."""

_DIVISOR = "a divisor that cannot be 0, as `max(d, 1e-9)` for a `d` that is never below 0"

_STIFF = (
    "`integrator: {rk4: {substeps: 10}}` or `linear_implicit` of the states whose `der:` grows: "
    "the step is too long for them"
)


def divergence_repair(
    program: Program, origin: Node, *, overflows: bool, second_order: bool, before_updates: bool
) -> str:
    """The advice for the user.

    `origin` is the first non-finite value; `overflows` is true if it is too large. Before any
    update, the weights are those of the spec, so learning rate and step limits would not help.
    """
    if not overflows:
        match origin.op:
            case ops.Apply(function) if function in _IN_DOMAIN:
                return f"write {_IN_DOMAIN[function]}"
            case ops.Divide():
                return f"write {_DIVISOR}"
            case _:
                pass
    repairs: list[str] = []
    # a state of which a formula gives the derivative is integrated
    if any(formula.left.startswith("der(") for formula in program.formulas):
        repairs.append(_STIFF)
    if before_updates:
        repairs.append("initial values with which the rollout stays finite")
    elif second_order:
        repairs.append("weights to begin with that are nearer")
    else:
        repairs.append("a smaller learning rate, `clip:`")
    return f"try {', '.join(repairs)}, a shorter horizon, or bounds"
