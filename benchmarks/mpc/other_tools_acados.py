"""Solves the network's problem by acados: SQP on the exact curvature, QPs by HPIPM.

`comma-deps-acados` has acados' libraries and templates, in other folders than those where its
Python interface looks for them: a folder of links has them there. DAQP, with which a build of newer
sources was fastest, is not among them; qpOASES ends at its own limit of working sets on every QP
with soft limits.
"""

from __future__ import annotations

import ctypes
import importlib
import os
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from other_tools_problems import N, Nlp, Vector

TIMES = 5
"""How often a solve is repeated from the same beginning; the shortest counts."""
LIBRARIES = ("blasfeo", "hpipm", "qpOASES_e", "acados")
SOFT = {"zl": 1e3, "zu": 1e3, "Zl": 1.0, "Zu": 1.0}
"""Exact penalties of state limits, those of the spec: hard ones leave QPs infeasible."""


class Acados:
    """acados with one QP solver; times are its own, without the Python interface."""

    def __init__(self, nlp: Nlp, step: ca.Function, qp_solver: str, folder: Path) -> None:
        self._solver = _solver(nlp, step, qp_solver, folder)
        self.begin()

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        self._solver.reset()
        self._plan = self._kept()

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves from the last plan with its multipliers, a sample later."""
        solver, before = self._solver, _later(self._plan)
        shortest = np.inf
        for end in ("lbx", "ubx"):
            solver.set(0, end, p)
        for _ in range(TIMES):
            for field, values in before.items():
                for k, value in enumerate(values):
                    solver.set(k, field, value)
            solver.solve()
            shortest = min(shortest, float(np.ravel(solver.get_stats("time_tot"))[0]))
        self._plan = self._kept()
        x, u, lam = (self._plan[field] for field in ("x", "u", "lam"))
        plan: list[Vector] = []
        multipliers: list[Vector] = []
        for k in range(N + 1):
            controls = int(k < N)
            own = lam[k][: 2 * (2 + controls)].reshape(2, -1)
            # of each stage its controls come first, and all lower limits before the upper ones
            pulls = own[1] - own[0]
            plan += [x[k], *([u[k]] if controls else [])]
            multipliers += [pulls[controls:], pulls[:controls]]
        return shortest, np.concatenate(plan), np.concatenate(multipliers)

    def _kept(self) -> dict[str, list[Vector]]:
        ends = {"x": N + 1, "u": N, "pi": N, "lam": N + 1, "sl": N + 1, "su": N + 1}
        return {f: [self._solver.get(k, f) for k in range(n)] for f, n in ends.items()}


def _later(plan: dict[str, list[Vector]]) -> dict[str, list[Vector]]:
    """The plan shifted by one sample; stages with other limits are not shifted."""
    found: dict[str, list[Vector]] = {}
    for field, values in plan.items():
        moved = [*values[1:], values[-1]]
        sizes = zip(values, moved, strict=True)
        found[field] = [new if new.shape == old.shape else old for old, new in sizes]
    return found


def _solver(nlp: Nlp, step: ca.Function, qp_solver: str, folder: Path) -> Any:
    template = _interface(folder / "acados")
    ocp, model = template.AcadosOcp(), template.AcadosModel()
    model.name, model.x, model.u = qp_solver.lower(), ca.SX.sym("x", 2), ca.SX.sym("u", 1)
    model.disc_dyn_expr = step(model.x, model.u)
    model.cost_expr_ext_cost = model.x[0] ** 2 + 0.01 * model.x[1] ** 2 + 0.02 * model.u[0] ** 2
    model.cost_expr_ext_cost_e = 10 * model.x[0] ** 2 + 0.1 * model.x[1] ** 2
    ocp.model, ocp.dims.N, ocp.solver_options.tf = model, N, float(N)
    ocp.cost.cost_type = ocp.cost.cost_type_e = "EXTERNAL"
    limits, both = ocp.constraints, np.array([0, 1])
    limits.x0, limits.idxbu = np.zeros(2), np.array([0])
    limits.lbu, limits.ubu = nlp.low[2:3], nlp.high[2:3]
    for end in ("", "_e"):
        setattr(limits, f"lbx{end}", nlp.low[:2])
        setattr(limits, f"ubx{end}", nlp.high[:2])
        for name in ("idxbx", "idxsbx"):
            setattr(limits, name + end, both)
        for name, price in SOFT.items():
            setattr(ocp.cost, name + end, np.full(2, price))
    options: dict[str, Any] = {
        "integrator_type": "DISCRETE",
        "nlp_solver_type": "SQP",
        "hessian_approx": "EXACT",
        "regularize_method": "PROJECT",
        "qp_solver": qp_solver,
        "qp_solver_cond_N": 5,
        "qp_solver_warm_start": 1,
        "nlp_solver_max_iter": 50,
        "print_level": 0,
    }
    # the judge asks for 1e-6 by scales of its own
    options |= {f"nlp_solver_tol_{kind}": 1e-7 for kind in ("stat", "eq", "ineq", "comp")}
    for name, value in options.items():
        setattr(ocp.solver_options, name, value)
    own = folder / qp_solver
    own.mkdir()
    ocp.code_export_directory = str(own / "code")
    return template.AcadosOcpSolver(ocp, json_file=str(own / "ocp.json"), verbose=False)


def _interface(root: Path) -> Any:
    """acados' Python interface, with its libraries loaded and found below `root`."""
    found: Any = importlib.import_module("acados")
    package = Path(found.__file__).parent
    inner = root / "interfaces" / "acados_template"
    if not root.exists():
        inner.mkdir(parents=True)
        (inner / "acados_template").symlink_to(package / "acados_template")
        for name in ("lib", "include", "bin", "cmake"):
            (root / name).symlink_to(package / "install" / name)
    os.environ["ACADOS_SOURCE_DIR"] = str(root)
    os.environ["TERA_PATH"] = found.TERA_PATH
    for name in LIBRARIES:
        ctypes.CDLL(str(root / "lib" / f"lib{name}.so"), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module("acados.acados_template")
