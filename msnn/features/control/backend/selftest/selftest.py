"""Writes the C self-test of a controller: inputs it must refuse, solves it must reproduce."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

from backends.c_language.literals import Dtype
from backends.c_language.rendering import render
from msnn.features.control.backend.constants import reachable
from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.numbers import TypedLiterals
from msnn.features.control.backend.selftest.golden_solves import FAR, Call, golden_solves
from msnn.features.control.backend.selftest.starts import drawn_starts
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.problem.optimal_control.problem import ControlProblem


@dataclass(frozen=True, slots=True)
class SelfTest:
    """The names that the template of a self-test needs."""

    model: str
    prefix: str
    takes_parameters: bool = False


def selftest_texts(
    problem: ControlProblem, prefix: str, dtype: Dtype, texts: Mapping[str, str]
) -> dict[str, str]:
    """Returns the text of `src/<prefix>_mpc_selftest.c`, by path.

    `texts` are the other files of the controller, which are compiled to record golden solves. The
    problem must have no parameters.
    """
    problem = replace(problem, tolerance=reachable(problem.tolerance, dtype))
    name = f"{prefix}_mpc"
    numbers, rows = TypedLiterals(dtype), rows_of(problem)
    fields = input_fields(problem)
    counts = [field.count for field in fields]
    controls = rows.rows[: problem.controls.size]
    text = render(
        "selftest.c.j2",
        SelfTest(problem.program.name, name),
        "Self-test of the predictive controller",
        "mpc",
        real=numbers.real,
        num=numbers.literal,
        braced=numbers.braced,
        starts=drawn_starts(problem),
        tolerance=numbers.literal(problem.tolerance),
        nan="NAN" if dtype == "float32" else "(double)NAN",
        lowest=[_end(row.minimum, float("-inf"), rows.move) for row in controls],
        highest=[_end(row.maximum, float("inf"), rows.move) for row in controls],
        fields=[(field, sum(counts[:number])) for number, field in enumerate(fields)],
        known=sum(counts),
        # computed limits may be NaN if the references are 0
        highest_status="INPUT_NOT_FINITE" if rows.move else "INFEASIBLE",
        golden=golden_solves(problem, texts, name) or (),
        calls=get_args(Call),
        far=numbers.literal(FAR),
    )
    return {f"src/{name}_selftest.c": text}


def _end(limit: float | None, without: float, moves: bool) -> float:
    """Returns a constant limit; `without` if there is none or it depends on references."""
    return without if limit is None or moves else limit
