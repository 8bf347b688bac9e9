"""Brings a problem into condensed form: states are eliminated and only controls are decided."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compiler.hessian.step_derivatives import StepDerivatives, next_value
from compiler.ir.ops import Read, ReadSignal
from compiler.ir.program import Graph, NodeId
from compiler.jacobian.matrices import Matrix, Member
from msnn.features.control.backend.stage_code.array_places import (
    NOWHERE,
    PlacedMatrix,
    Series,
    places_in_series,
    series_of,
)
from msnn.features.control.backend.stage_code.stage_functions import StageArrays
from msnn.features.control.backend.structure.form import (
    Addresses,
    Form,
    PlanLayout,
    Stages,
    numbers_of,
    stages_of_problem,
)
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Sample, window_form


def condensed_form(problem: ControlProblem, rows: Rows) -> Form:
    """Builds the condensed form of a problem; `rows` are its limits.

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


_NARROW = 4
"""Maximum number of variables of a path constraint for which all of them enter the Hessian.

The barrier of such a constraint is then added to the Hessian of its stage.
"""


@dataclass(frozen=True, slots=True)
class Classes:
    """The order of the elements of (x, u), sorted by class, and the size of each class."""

    order: tuple[int, ...]
    """The index in (x, u) of each sorted element."""
    curved: int
    """Number of elements in the Hessian."""
    moving: int
    """Number of elements in the Hessian or with varying Jacobian columns."""
    narrow: tuple[bool, ...]
    """For each bounded row, True if all variables that it depends on are in the Hessian."""
    steady: tuple[bool, ...]
    """For each result element, True if it depends on elements with constant columns."""

    @property
    def plain(self) -> int:
        """The number of elements of (x, u) with Jacobian columns constant along the horizon."""
        return len(self.order) - self.moving


def classes_of(problem: ControlProblem, rows: Rows, stages: Stages) -> Classes:
    """Sorts the elements of (x, u) of a condensed problem into classes.

    `stages` has the derivatives that decide on the class.
    """
    nx, nu = problem.states.size, problem.controls.size
    stage, end = stages.stage, stages.terminal
    columns, at_end = (numbers_of(problem, each.variables) for each in (stage, end))
    jacobian = np.zeros((stages.size, nx + nu), np.bool_)
    of_results = [stages.results[m.name] + i for m in stage.results.members for i in range(m.size)]
    jacobian[np.array(of_results, np.int64)[:, None], columns] = _entries(stage.jacobian)
    assert stage.hessian is not None
    assert end.hessian is not None
    curved = np.zeros(nx + nu, np.bool_)
    curved[columns] = _entries(stage.hessian).any(axis=0)
    curved[at_end] |= _entries(end.hessian).any(axis=0)
    # controls are always in the Hessian: the barriers of their limits add to it
    curved[nx:] = True
    # limits of rates couple a control with the state that holds its previous value
    for rate in rows.rates:
        curved[rate.before] = True
    # results after the cost are bounded values; rows before theirs belong to controls and rates
    first = len(rows.rows) - (stages.size - stages.results[problem.stage] - 1)
    of_paths = jacobian[stages.results[problem.stage] + 1 :]
    for row in of_paths:
        # a constraint of few variables is cheaper in the Hessian than as a separate row
        if np.count_nonzero(row) <= _NARROW:
            curved |= row
    narrow = (True,) * first + tuple(bool(np.all(curved[row])) for row in of_paths)
    moving = curved.copy()
    # the end of the horizon has other functions, so that its columns differ from those of stages
    moving[at_end] |= _entries(end.jacobian).any(axis=0)
    moving[columns] |= _moving_columns(problem, stage.graph, stage.jacobian)
    kinds = np.where(curved, 0, np.where(moving, 1, 2))
    kinds[nx:] = 0
    # a stable sort keeps the order within each class
    order = tuple(int(i) for i in np.argsort(kinds, kind="stable"))
    count = int(np.count_nonzero(moving))
    plain = list(order[count:])
    steady = tuple(bool(np.any(row)) for row in jacobian[:, plain])
    return Classes(order, int(np.count_nonzero(curved)), count, narrow, steady)


def _entries(matrix: Matrix) -> NDArray[np.bool_]:
    """Returns the mask, of the matrix's shape, of entries that are not constantly 0."""
    # None marks a computed entry, which counts too
    return np.array([number != 0 for number in matrix.known], np.bool_).reshape(matrix.shape)


def _moving_columns(problem: ControlProblem, graph: Graph, jacobian: Matrix) -> NDArray[np.bool_]:
    """Returns the mask of Jacobian columns with an entry that changes along the horizon."""
    moves = _moving_nodes(problem, graph)
    mask = np.zeros(jacobian.shape[1], np.bool_)
    for block in jacobian.blocks:
        if block.node in moves:
            entries = block.places(graph[block.node].type.shape).ravel()
            known = [jacobian.known[entry] is None for entry in entries]
            # entries are numbered row by row
            mask[entries[known] % jacobian.shape[1]] = True
    return mask


def _moving_nodes(problem: ControlProblem, graph: Graph) -> set[NodeId]:
    """Returns the nodes whose values can change from stage to stage."""
    # held disturbances and references are constant along the horizon
    held = {m.name for m in _given(problem)} - problem.previewed
    moves: set[NodeId] = set()
    for index, node in graph:
        op = node.op
        is_leaf = isinstance(op, Read)
        is_held = isinstance(op, ReadSignal) and op.signal in held
        if (is_leaf and not is_held) or any(arg in moves for arg in node.args):
            moves.add(index)
    return moves


def _given(problem: ControlProblem) -> Iterable[Member]:
    """Returns the disturbances and references of a problem."""
    return (*problem.disturbances.members, *problem.references.members)
