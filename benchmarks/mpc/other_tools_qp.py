"""Solves problems by sequences of QPs with OSQP and PIQP, and times only the QP solvers.

Derivatives come from CasADi and are not timed, nor is the test that ends a sequence: the times are
lower bounds for a controller. The Hessian of each stage is shifted to positive eigenvalues; steps
are taken in full.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import osqp
import piqp
from numpy.typing import NDArray
from other_tools_casadi import later
from other_tools_problems import Nlp, Vector
from scipy import sparse

MOST = 30
LEAST = 1e-6  # eigenvalue of a block
NDArrayBool = NDArray[np.bool_]
Judge = Callable[[Vector, Vector, Vector], float]


class Sequence:
    """A solver by a sequence of QPs, until the optimality conditions hold."""

    def __init__(self, nlp: Nlp, tool: Osqp | Piqp, judge: Judge) -> None:
        self.nlp = nlp
        self._tool = tool
        self._judge = judge
        parts = nlp.expressions
        kind: Any = type(parts["x"])
        weights = kind.sym("w", parts["g"].shape[0])
        lagrangian = parts["f"] + ca.dot(weights, parts["g"])
        bend, _ = ca.hessian(lagrangian, parts["x"])
        results: list[Any] = [ca.gradient(parts["f"], parts["x"]), parts["g"]]
        results += [ca.jacobian(parts["g"], parts["x"]), bend]
        self._slopes = ca.Function("slopes", [parts["x"], parts["p"], weights], results)
        tool.expect(np.array(ca.DM(results[2].sparsity(), 1)) != 0)
        self.begin()

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        self._plan = np.zeros(self.nlp.numbers)
        self._weights = np.zeros(self.nlp.expressions["g"].shape[0])

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves from the last plan, a sample later."""
        plan = later(self._plan, self.nlp.stage)
        weights = later(self._weights, self.nlp.rows)
        multipliers = np.zeros_like(plan)
        seconds = 0.0
        for _ in range(MOST):
            slope, gap, steep, bend = self._slopes(plan, p, weights)
            qp = (
                self._lifted(np.array(bend)),
                np.array(slope).ravel(),
                np.array(steep),
                -np.array(gap).ravel(),
                self.nlp.low - plan,
                self.nlp.high - plan,
            )
            took, step, weights, multipliers = self._tool.solve(*qp)
            seconds += took
            if not np.all(np.isfinite(step)):
                break
            plan = plan + step
            if self._judge(p, plan, multipliers) <= 1e-6:
                break
        is_finite = bool(np.all(np.isfinite(plan)) and np.all(np.isfinite(weights)))
        self._plan = plan if is_finite else np.zeros_like(plan)
        self._weights = weights if is_finite else np.zeros_like(weights)
        return seconds, plan, multipliers

    def _lifted(self, bend: Vector) -> Vector:
        size = self.nlp.stage
        lifted = np.zeros_like(bend)
        for k in range(0, len(bend), size):
            here = slice(k, k + size)
            values, vectors = np.linalg.eigh(bend[here, here])
            lifted[here, here] = (vectors * np.maximum(values, LEAST)) @ vectors.T
        return lifted


class Osqp:
    """Solves QPs of one sparsity pattern by OSQP; returns multipliers of rows, then of bounds."""

    def expect(self, steep: NDArrayBool) -> None:
        """Sets the sparsity pattern of the rows of later QPs."""
        size = steep.shape[1]
        self._solver: Any = None
        self._bends = np.triu(_near(size))
        self._rows = np.vstack([steep, np.eye(size) != 0])

    def solve(
        self, bend: Vector, slope: Vector, steep: Vector, right: Vector, low: Vector, high: Vector
    ) -> tuple[float, Vector, Vector, Vector]:
        """Solves one QP; the time is the one that OSQP reports."""
        rows = np.vstack([steep, np.eye(len(slope))])
        lower, upper = np.r_[right, low], np.r_[right, high]
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(
                _of_pattern(bend, self._bends),
                slope,
                _of_pattern(rows, self._rows),
                lower,
                upper,
                verbose=False,
                eps_abs=1e-8,
                eps_rel=1e-8,
                polishing=True,
                max_iter=20000,
            )
        else:
            self._solver.update(
                q=slope,
                l=lower,
                u=upper,
                Px=_of_pattern(bend, self._bends).data,
                Ax=_of_pattern(rows, self._rows).data,
            )
        found = self._solver.solve(raise_error=False)
        count = len(right)
        return found.info.run_time, found.x, found.y[:count], found.y[count:]


class Piqp:
    """Solves sparse QPs by PIQP; returns multipliers of rows, then of bounds."""

    def expect(self, steep: NDArrayBool) -> None:
        """Sets the sparsity pattern of the rows of later QPs."""
        self._solver: Any = None
        self._bends = np.triu(_near(steep.shape[1]))
        self._rows = steep

    def solve(
        self, bend: Vector, slope: Vector, steep: Vector, right: Vector, low: Vector, high: Vector
    ) -> tuple[float, Vector, Vector, Vector]:
        """Solves one QP; the time is the one that PIQP reports."""
        qp = {
            "P": _of_pattern(bend, self._bends),
            "c": slope,
            "A": _of_pattern(steep, self._rows),
            "b": right,
            "x_l": low,
            "x_u": high,
        }
        if self._solver is None:
            self._solver = piqp.SparseSolver()
            self._solver.settings.eps_abs = 1e-9
            self._solver.settings.eps_rel = 1e-9
            self._solver.settings.compute_timings = True
            self._solver.setup(**qp)
        else:
            self._solver.update(**qp)
        self._solver.solve()
        found = self._solver.result
        bounds = np.asarray(found.z_bu) - np.asarray(found.z_bl)
        return found.info.run_time, np.array(found.x), np.array(found.y), bounds


def _near(size: int) -> NDArrayBool:
    # as wide as the widest block of a stage, so that the pattern stays
    at = np.arange(size)
    return np.abs(at[:, None] - at[None, :]) < 3


def _of_pattern(matrix: Vector, pattern: NDArrayBool) -> Any:
    marked: Any = sparse.csc_matrix(pattern.astype(float))
    marked.data = matrix.T[pattern.T]
    return marked
