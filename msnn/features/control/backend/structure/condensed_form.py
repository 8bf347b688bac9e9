"""Brings a problem into condensed form: states are eliminated and only controls are decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compiler.hessian.step_derivatives import StepDerivatives, next_value
from msnn.features.control.backend.stage_code.placed_matrix import NOWHERE, PlacedMatrix
from msnn.features.control.backend.stage_code.series import Series, places_in_series, series_of
from msnn.features.control.backend.stage_code.stage_functions import StageArrays
from msnn.features.control.backend.structure.classes import Classes, classes_of
from msnn.features.control.backend.structure.form import Addresses, Form, PlanLayout
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.backend.structure.stages import Stages, numbers_of, stages_of_problem
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.window_form import Sample, window_form


def condensed_form(problem: ControlProblem, rows: Rows) -> Form:
    """Builds the condensed form of a problem.

    The plan is stored as time series (`series`); a stage reads states, controls and windows from
    them.
    """
    form = window_form(problem)
    series = series_of(problem, form)
    own = [name for name in form.names if next_value(name) in form.results]
    following = list(zip(form.results, form.sizes, strict=True))
    stages = stages_of_problem(problem, form.program, rows, following, own)
    classes = classes_of(problem, rows, stages)
    return Form(
        stages=stages,
        stage=replace(
            _arrays(problem, series, stages, stages.stage, stages.results, classes),
            steady=_steady_numbers(problem, classes),
        ),
        terminal=_arrays(
            problem, series, stages, stages.terminal, stages.terminal_results, classes
        ),
        steady=_steady(problem, stages, classes) if classes.plain else None,
        shapes=_shapes(problem, series, stages, classes),
        places_of_memory=series.of_memory(),
        newest=form.newest,
        plan=PlanLayout("condensed", _places(problem, series), 1),
        addresses=Addresses(
            stage="(c->{} + {})",
            state="STATE[{}]",
            memory="REMEMBERED[{}]",
            control="CONTROL[{}]",
            measured="c->measured[NEWEST[{}]]",
            has_blocks=problem.has_blocks,
        ),
        facts=_tables(problem, rows, series, classes),
    )


def _places(problem: ControlProblem, series: Series) -> tuple[int, ...]:
    """Returns the index in the array `z` of each element of (x, u) at stage 0."""
    controls = (series.control(number) for number in range(problem.controls.size))
    return (*series.of_memory(), *controls)


def _shapes(
    problem: ControlProblem, series: Series, stages: Stages, classes: Classes
) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of the solver's arrays that differ between the structures, by name."""
    # stages 0 … N; stage N is the end of the horizon
    count, states = problem.horizon + 1, series.form.states
    nu = problem.controls.size
    decided = len(problem.blocks) * nu
    # C has no arrays without elements
    some = max(states, 1)
    rows = (count, len(classes.narrow))
    return {
        "z": (series.size,),
        "dz": (series.size,),
        "price": (),
        "slopes": (count, stages.size, classes.moving),
        **({"steady": (stages.size, classes.plain)} if classes.plain else {}),
        "curvature": (count, classes.curved, classes.curved),
        "pull": rows,
        **({} if all(classes.narrow) else {"stiff": rows}),
        "sensitivity": (count, some, decided),
        "hessian": (decided, decided),
        "gain": (1, nu, problem.states.size),
        "advance": (len(problem.blocks), nu),
    }


def _tables(
    problem: ControlProblem, rows: Rows, series: Series, classes: Classes
) -> dict[str, object]:
    """Returns the sizes and index tables that the templates of a condensed solver read."""
    form, nu = series.form, problem.controls.size
    samples = [*form.memory, *(Sample(is_control=True, number=i, lag=0) for i in range(nu))]
    read = [samples[number] for number in classes.order]
    begins, ends = _runs(read[classes.moving :])
    before = [classes.order.index(rate.before) for rate in rows.rates]
    return {
        "core": form.states,
        "moving": classes.moving,
        "curved": classes.curved,
        "plain": classes.plain,
        "series": series.size,
        "wide": not all(classes.narrow),
        "firsts": list(series.firsts),
        "lasts": list(series.lasts),
        "state_places": list(series.now[: form.states]),
        "control_places": list(series.now[form.states :]),
        "memory_places": list(series.of_memory()),
        "newest": list(form.newest),
        "places": [series.place(sample) for sample in read],
        "lags": [sample.lag for sample in read],
        "source_numbers": [sample.number for sample in read],
        "is_control": [int(sample.is_control) for sample in read],
        "read_numbers": list(classes.order),
        "curved_before": before,
        "run_begins": begins,
        "run_ends": ends,
        "narrow": [int(is_narrow) for is_narrow in classes.narrow],
        "has_steady": [int(is_steady) for is_steady in classes.steady],
    }


def _runs(samples: Sequence[Sample]) -> tuple[list[int], list[int]]:
    """Returns the start and end indices of runs of consecutive samples of one scalar signal."""
    begins = [
        at
        for at, sample in enumerate(samples)
        # a run continues while the lag decreases by one within the same series
        if at == 0 or replace(samples[at - 1], lag=samples[at - 1].lag - 1) != sample
    ]
    return begins, [*begins[1:], len(samples)][: len(begins)]


def _arrays(
    problem: ControlProblem,
    series: Series,
    stages: Stages,
    derivatives: StepDerivatives,
    results: Mapping[str, int],
    classes: Classes,
) -> StageArrays:
    """Returns the array layout of the stage, or end of the horizon, with these derivatives.

    The array `slopes` has the varying Jacobian columns alone.
    """
    of_results = [results[m.name] + i for m in derivatives.results.members for i in range(m.size)]
    at = _positions(problem, derivatives, classes)
    assert derivatives.hessian is not None
    curved, moving = classes.curved, classes.moving
    # variables are sorted by class: those in the Hessian first, then those with varying Jacobian
    # columns, then those with constant columns
    columns = np.where(at < curved, at, NOWHERE)
    first, last = (min(of_results), max(of_results) + 1) if of_results else (0, 0)
    return StageArrays(
        variables=places_in_series(problem, series),
        results=results,
        given=stages.given,
        slopes=PlacedMatrix(
            "slopes",
            derivatives.jacobian,
            # the array index of each row: rows have `moving` elements
            np.array(of_results, int) * moving,
            np.where(at < moving, at, NOWHERE),
            first * moving,
            last * moving,
        ),
        curvature=PlacedMatrix(
            "curvature",
            derivatives.hessian,
            np.where(columns >= 0, columns * curved, NOWHERE),
            columns,
            0,
            curved * curved,
        ),
    )


def _steady(problem: ControlProblem, stages: Stages, classes: Classes) -> PlacedMatrix:
    """Returns the layout of the array `steady` of constant Jacobian columns."""
    stage = stages.stage
    of_results = [stages.results[m.name] + i for m in stage.results.members for i in range(m.size)]
    at = _positions(problem, stage, classes)
    columns = np.where(at >= classes.moving, at - classes.moving, NOWHERE)
    rows = np.array(of_results, int) * classes.plain
    size = stages.size * classes.plain
    return PlacedMatrix("steady", stage.jacobian, rows, columns, 0, size, takes_zeros=False)


def _steady_numbers(problem: ControlProblem, classes: Classes) -> dict[str, tuple[bool, ...]]:
    """Returns for each state the mask of its elements whose Jacobian columns are constant."""
    steady = set(classes.order[classes.moving :])
    return {
        m.name: tuple(m.first + i in steady for i in range(m.size)) for m in problem.states.members
    }


def _positions(
    problem: ControlProblem, derivatives: StepDerivatives, classes: Classes
) -> NDArray[np.int64]:
    """Returns the position in the order of `classes` of each variable of the derivatives."""
    # argsort of a permutation is its inverse
    position = np.argsort(np.array(classes.order))
    return position[numbers_of(problem, derivatives.variables)]
