"""Sorts the elements of (x, u) by their part in the Jacobian and Hessian of a condensed stage.

First come elements with a row in the Hessian. Then come others whose Jacobian columns change from
stage to stage. Last come elements with columns that are constant along the horizon; past controls
that an FIR filter reads are the typical case. Constant columns are computed once per solve.
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
