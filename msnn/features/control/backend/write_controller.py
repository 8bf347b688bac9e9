"""Writes the C files of a model predictive controller: header, source, kernels, self-test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from backends.c.folder.header_text import origin
from backends.c_kernels.sources import c_sources
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.literals import Dtype
from backends.c_language.printer import Printer
from backends.c_language.rendering import GeneratedNames, render
from backends.c_language.tree import Function
from backends.files.atomic_write import write_text
from backends.files.export_identity import with_identity
from msnn.features.control.backend.about import Sizes, about_text, members
from msnn.features.control.backend.constants import (
    TypedLiterals,
    floor_of_curvature,
    most_factors,
    reachable,
    solver_constants,
)
from msnn.features.control.backend.inputs import input_fields, quantity_lines
from msnn.features.control.backend.selftest import selftest_texts
from msnn.features.control.backend.stage_code.stage_functions import (
    PlacedLimit,
    StageFunctions,
    StageWriter,
)
from msnn.features.control.backend.structure.condensed_form import condensed_form
from msnn.features.control.backend.structure.form import Form
from msnn.features.control.backend.structure.rows import Rows, resting_controls, rows_of
from msnn.features.control.backend.structure.staged_form import staged_form
from msnn.features.control.problem.cost_scale import with_scaled_cost
from msnn.features.control.problem.horizon import block_starts, previous_places
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import chosen_structure
from msnn.features.control.problem.trained import trained

MOST_SIMULATIONS = 3
"""Maximum number of restarts per solve at a newly simulated plan.

Each costs as much as the values of one iteration.
"""


def write_controller(
    problem: ControlProblem,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    *,
    prefix: str,
    dtype: Dtype,
) -> tuple[Path, ...]:
    """Writes header, sources, self-test and description of a controller into a folder. Returns the
    paths written; raises OSError if a file cannot be written.

    The files are `include/<prefix>_mpc.h`, `src/<prefix>_mpc*.c` and `<prefix>_mpc.json`. `weights`
    has the physical value of each parameter by name.
    """
    known = trained(problem, weights)
    texts = controller_texts(known, prefix, dtype)
    texts = with_identity(texts | selftest_texts(known, prefix, dtype, texts))
    return tuple(write_text(folder / name, text) for name, text in texts.items())


def controller_texts(problem: ControlProblem, prefix: str, dtype: Dtype) -> dict[str, str]:
    """Returns the text of each file, by relative path, without the self-test.

    The problem must have no parameters.
    """
    return solver_texts(problem, f"{prefix}_mpc", dtype, "Predictive controller", _about(problem))


def solver_texts(
    problem: ControlProblem,
    name: str,
    dtype: Dtype,
    title: str,
    about: str,
    *,
    is_window: bool = False,
) -> dict[str, str]:
    """Returns the text of each file of the solver of a problem, by relative path. The problem must
    have no parameters.

    `name` is the prefix of files and functions, `title` and `about` are texts of the header. With
    `is_window`, the solver of a moving-horizon estimator, the files have only init, reset and
    solve, no feedback and no self-test.
    """
    # with a tolerance below the type's precision every solve would end at the iteration limit
    cost_scale = problem.cost_scale
    problem = with_scaled_cost(replace(problem, tolerance=reachable(problem.tolerance, dtype)))
    controller = GeneratedNames(problem.program.name, name)
    rows = rows_of(problem)
    numbers = TypedLiterals(dtype)
    table = FunctionTable(FunctionNames(name, dtype, "own"))
    structure = chosen_structure(problem)
    made = (condensed_form if structure == "condensed" else staged_form)(problem, rows)
    fields = input_fields(problem)
    nx, nu = problem.states.size, problem.controls.size
    scales = [problem.state_scales[m.name] for m in problem.states.members for _ in range(m.size)]
    of_rows = [row.scale for row in rows.rows]
    factors = most_factors(max([1.0, *scales, *of_rows[:nu]]), dtype)
    stage, terminal, functions = _functions(problem, rows, table, numbers.real, made, factors)
    given = made.stages.given.size
    results = made.stages.size
    # row r has its minimum at index 2 r and its maximum at 2 r + 1
    sides = [limit for row in rows.rows for limit in (row.minimum, row.maximum)]
    hard = [int(row.hard) for row in rows.rows]
    # a limit of a rate depends on two controls: projection handles single controls only
    projects = structure == "condensed" and not rows.rates
    sizes = Sizes(
        horizon=problem.horizon,
        memory=nx,
        controls=nu,
        results=results,
        sides=len(sides),
        kept=max(stage.kept, terminal.kept),
        kept_at_end=terminal.kept,
        given=given,
        limits_move=rows.move,
        has_hard=any(hard),
        past_moves=structure == "condensed",
    )
    struct = members(sizes, made.shapes, numbers.real)
    # indices in (x, u) of the variables of a stage, in the order of the form
    read_numbers: list[int] = made.facts["read_numbers"]
    of_stage = [[*scales, *of_rows[:nu]][at] for at in read_numbers]
    # C has no empty arrays: without states the array has one unused element
    of_states = [scales[at] for at in made.newest] or [1.0]
    least_curvature = floor_of_curvature(dtype)
    nothing = f"(const {numbers.real} *)0"
    facts: dict[str, object] = {
        **made.facts,
        **block_tables(problem),
        "at": made.addresses,
        "condensed": structure == "condensed",
        "projects": projects,
        "members": struct,
        **origin(problem.program),
        "is_window": is_window,
        "about": numbers.comment(about),
        "real": numbers.real,
        "num": numbers.literal,
        "braced": numbers.braced,
        "constants": solver_constants(
            problem.tolerance,
            dtype,
            structure,
            problem.mode,
            can_be_infinite=stage.can_be_infinite or terminal.can_be_infinite,
            has_hard=any(hard),
            projects=projects,
        ),
        "horizon": problem.horizon,
        "states": nx,
        "controls": nu,
        "stage": nx + nu,
        "results": results,
        # results are next values, the cost, then bounded values
        "paths": results - made.stages.results[problem.stage] - 1,
        "terminal_paths": rows.terminal,
        "sides": 2 * len(rows.rows),
        "rates": [
            {
                "control": r.control,
                "before": r.before,
                "place": made.places_of_memory[r.before],
                "most": numbers.literal(r.most),
            }
            for r in rows.rates
        ],
        "kept": max(stage.kept, terminal.kept),
        # without saved values at the end of the horizon, its function gets an array it does not
        # read
        "last_kept": f"c->kept[{'k' if terminal.kept else 0}]",
        "given_of_stage": "c->given[k]" if given else nothing,
        "given_of_all": "c->given[0]" if given else nothing,
        "given": given,
        "fields": fields,
        "state_lines": quantity_lines(problem.states, "x"),
        "control_lines": quantity_lines(problem.controls, "u"),
        "most_simulations": MOST_SIMULATIONS,
        "exists": [int(limit is not None) for limit in sides],
        "limits": [0.0 if limit is None else limit for limit in sides],
        "limits_move": rows.move,
        "scales": of_rows,
        "state_scales": of_states,
        "stage_scales": of_stage,
        "per_row": [1 / scale for scale in of_rows],
        "per_state": [1 / scale for scale in of_states],
        "per_memory": [1 / scale for scale in scales],
        "floors": [least_curvature / scale**2 for scale in of_rows[:nu]],
        "linear": [row.linear for row in rows.rows],
        "quadratic": [row.quadratic for row in rows.rows],
        "hard": hard if any(hard) else [],
        "resting": resting_controls(rows, nu),
        "can_be_infinite": stage.can_be_infinite or terminal.can_be_infinite,
        "can_end": stage.can_end or terminal.can_end,
        "lacks_steady": stage.lacks_steady,
        "starts_again": problem.starts_again,
        "most_iterations": problem.most_iterations,
        "gauss_newton": problem.hessian == "gauss_newton",
        "iterations": problem.iterations,
        "log_terms": 15 if dtype == "float64" else 7,
        "functions": [Printer(name, dtype).function(function) for function in functions],
        "kernels": bool(table.kernels),
    }

    def text(template: str, title: str) -> str:
        return render(template, controller, title, "mpc", **facts)

    texts = {
        f"include/{name}.h": text("header.h.j2", title),
        f"src/{name}.c": text("controller.c.j2", title),
        f"{name}.json": about_text(
            problem,
            name,
            dtype,
            struct,
            fields,
            plan=made.plan,
            rows=rows,
            cost_scale=cost_scale,
        ),
    }
    if table.kernels:
        kernels = c_sources(table.kernels, numbers.real, name)
        texts[f"src/{kernels.header_name}"] = kernels.header
        texts[f"src/{kernels.source_name}"] = kernels.source
    return dict(sorted(texts.items()))


def _functions(
    problem: ControlProblem,
    rows: Rows,
    table: FunctionTable,
    real: str,
    made: Form,
    factors: float,
) -> tuple[StageFunctions, StageFunctions, list[Function]]:
    """Writes the C functions of a problem; `made` is its form, `factors` the argument of `can_end`.

    Returns those of a stage, those of the end of the horizon, and all in the order of the source.
    """
    writer = StageWriter(table, problem.program.formulas, real, factors)
    stage = writer.stage("", made.stages.stage, made.stage)
    terminal = writer.stage("terminal_", made.stages.terminal, made.terminal)
    functions = [stage.values, stage.slopes, terminal.values, terminal.slopes]
    if made.steady is not None:
        functions.append(writer.steady(made.stages.stage, made.stage, made.steady))
    if rows.move:
        limits = [
            PlacedLimit(problem.node(limit.output), limit.first_side, limit.size)
            for limit in rows.outputs
        ]
        functions.append(writer.limits(problem.program.step, limits, made.stages.given))
    return stage, terminal, [*table.definitions(), *functions]


def _about(problem: ControlProblem) -> str:
    """Returns the comment at the top of the header."""
    structure = chosen_structure(problem)
    how = "in the controls alone" if structure == "condensed" else "stage by stage"
    return (
        f"Finds the controls of {problem.horizon} samples by an interior-point method on the "
        f"problem of the spec's `mpc` section, {how}, and gives those of the first one."
    )


def block_tables(problem: ControlProblem) -> dict[str, object]:
    """Returns index tables of blocks of stages with constant controls, for the templates; `held` is
    False if every block is one sample.
    """
    if not problem.has_blocks:
        return {"held": False}
    # block_starts is True at the first stage of each block: its sum counts the blocks
    block = np.cumsum(block_starts(problem)) - 1
    decided = (0, *((block + 1) * problem.controls.size).tolist())
    return {
        "held": True,
        "blocks": len(problem.blocks),
        "longest_block": max(problem.blocks),
        "block_of_stage": block.tolist(),
        "block_begins": np.cumsum((0, *problem.blocks)).tolist(),
        "decided_before": list(decided),
        "latest": previous_places(problem).tolist(),
    }
