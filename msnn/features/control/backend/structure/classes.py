"""Sorts the numbers that a stage reads by how its slopes and its curvature depend on them.

Numbers with a curvature come first, then others whose slopes change from stage to stage, at last
those whose slopes are the same along the horizon: of a filter of past controls nearly all. The
slopes of these are computed once a solve, and none of them needs a place in a Hessian.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compiler.ir.ops import Read, ReadSignal
from compiler.ir.program import Graph, NodeId
from compiler.jacobian.matrices import Matrix, Member
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.backend.structure.stages import Stages, numbers_of
from msnn.features.control.problem.optimal_control.problem import ControlProblem

_NARROW = 4
"""Numbers of a bounded row that are taken into the curvature for its sake."""


@dataclass(frozen=True, slots=True)
class Classes:
    """The order of the numbers of (x, u), and how many are of each class."""

    order: tuple[int, ...]
    curved: int
    moving: int
    narrow: tuple[bool, ...]
    """Of each row, whether all that it depends on has a curvature."""
    steady: tuple[bool, ...]
    """Of each result, whether it has slopes in numbers of the last class."""

    @property
    def plain(self) -> int:
        """The count of variables that have the same slopes along the horizon."""
        return len(self.order) - self.moving


def classes_of(problem: ControlProblem, rows: Rows, stages: Stages) -> Classes:
    """The classes of a problem."""
    nx, nu = problem.states.size, problem.controls.size
    found, end = stages.stage, stages.terminal
    columns, at_end = (numbers_of(problem, each.variables) for each in (found, end))
    jacobian = np.zeros((stages.size, nx + nu), np.bool_)
    of_results = [stages.results[m.name] + i for m in found.results.members for i in range(m.size)]
    jacobian[np.array(of_results, np.int64)[:, None], columns] = _entries(found.jacobian)
    assert found.hessian is not None
    assert end.hessian is not None
    curved = np.zeros(nx + nu, np.bool_)
    curved[columns] = _entries(found.hessian).any(axis=0)
    curved[at_end] |= _entries(end.hessian).any(axis=0)
    # controls always have curvature: limits add to it
    curved[nx:] = True
    # rates couple a control with the state that holds it
    for rate in rows.rates:
        curved[rate.before] = True
    # results after the cost are bounded values; rows before theirs are of controls and rates
    first = len(rows.rows) - (stages.size - stages.results[problem.stage] - 1)
    of_paths = jacobian[stages.results[problem.stage] + 1 :]
    for row in of_paths:
        # rows of few numbers are cheaper in the Hessian than as rows of their own
        if np.count_nonzero(row) <= _NARROW:
            curved |= row
    narrow = (True,) * first + tuple(bool(np.all(curved[row])) for row in of_paths)
    moving = curved.copy()
    # the end has a function of its own: what it reads has other slopes there
    moving[at_end] |= _entries(end.jacobian).any(axis=0)
    moving[columns] |= _moving_columns(problem, found.graph, found.jacobian)
    kinds = np.where(curved, 0, np.where(moving, 1, 2))
    kinds[nx:] = 0
    # a stable order: numbers of a class stay in theirs
    order = tuple(int(i) for i in np.argsort(kinds, kind="stable"))
    count = int(np.count_nonzero(moving))
    plain = list(order[count:])
    steady = tuple(bool(np.any(row)) for row in jacobian[:, plain])
    return Classes(order, int(np.count_nonzero(curved)), count, narrow, steady)


def _entries(matrix: Matrix) -> NDArray[np.bool_]:
    """The mask of the entries that are not always 0."""
    # None, a number that is computed, counts too
    return np.array([number != 0 for number in matrix.known], np.bool_).reshape(matrix.shape)


def _moving_columns(problem: ControlProblem, graph: Graph, jacobian: Matrix) -> NDArray[np.bool_]:
    """The columns with an entry that is computed of what changes along the horizon."""
    moves = _moving_nodes(problem, graph)
    found = np.zeros(jacobian.shape[1], np.bool_)
    for block in jacobian.blocks:
        if block.node in moves:
            entries = block.places(graph[block.node].type.shape).ravel()
            known = [jacobian.known[entry] is None for entry in entries]
            # entries are numbered row by row
            found[entries[known] % jacobian.shape[1]] = True
    return found


def _moving_nodes(problem: ControlProblem, graph: Graph) -> set[NodeId]:
    # what is the same along the horizon moves no slope
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
    return (*problem.disturbances.members, *problem.references.members)
