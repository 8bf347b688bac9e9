"""Lowers `linspace`, `arange`, `zeros`, `ones` to constants."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.lowering.constants import number, refuse_infinite, whole_number
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.tree import Call

LONGEST_LIST = 100_000


def number_list(name: str) -> Callable[[Context, Call, Environment], NodeId]:
    """The lowering of the builtin of that name, to a constant along an unnamed axis."""

    def lower_numbers(context: Context, call: Call, environment: Environment) -> NodeId:
        given = [number(context, each, f"an argument of `{name}`") for each in call.arguments]
        if name == "arange":
            count = _arange_count(given)
        else:
            count = whole_number(context, call.arguments[-1], f"the length of `{name}`")
        if not 1 <= count <= LONGEST_LIST:
            context.findings.report(
                names.unfit_constant(f"`{name}`", f"would have {count} elements", call.span)
            )
            raise LoweringFailed
        # a range from -1e308 to 1e308 overflows
        with np.errstate(all="ignore"):
            match name:
                case "linspace":
                    values = np.linspace(given[0], given[1], count)
                case "arange":
                    step = given[2] if len(given) > 2 else 1.0
                    start = given[0] if len(given) > 1 else 0.0
                    values = start + step * np.arange(count)
                case _:
                    values = np.full(count, 1.0 if name == "ones" else 0.0)
        refuse_infinite(context, f"`{name}`", values, call.span)
        return context.builder(environment).constant(values, (Axis(UNNAMED, count),))

    return lower_numbers


def _arange_count(given: list[float]) -> int:
    start, stop = (0.0, given[0]) if len(given) == 1 else (given[0], given[1])
    step = given[2] if len(given) > 2 else 1.0
    if step == 0 or not np.isfinite((stop - start) / step):
        return 0
    return max(0, int(np.ceil((stop - start) / step)))
