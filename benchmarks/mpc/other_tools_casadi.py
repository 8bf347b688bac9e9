"""Solves problems by CasADi's solvers, interpreted or generated to C, and times the solve alone."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from other_tools_problems import Nlp, Vector

QUIET = {"print_time": False, "error_on_fail": False}
QRQP = QUIET | {"print_iter": False, "print_header": False, "print_info": False}
TOLERANCE = 1e-6
OPTIONS: dict[str, dict[str, Any]] = {
    "ipopt": {"ipopt": {"print_level": 0, "sb": "yes", "tol": TOLERANCE}},
    "fatrop": {
        "structure_detection": "auto",
        "fatrop": {"print_level": 0, "tol": TOLERANCE, "mu_init": 1e-2},
    },
    "sqpmethod": {
        "qpsol": "qrqp",
        "qpsol_options": QRQP,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "convexify_strategy": "regularize",
        "tol_pr": TOLERANCE,
        "tol_du": TOLERANCE,
    },
}


class Interpreted:
    """A CasADi solver that runs in CasADi's virtual machine; the time is the solver's own."""

    def __init__(self, nlp: Nlp, plugin: str, **options: Any) -> None:
        self.nlp = nlp
        self._function = made(nlp, plugin, record_time=True, **options)
        self.begin()

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        self._plan = np.zeros(self.nlp.numbers)
        self._multipliers = np.zeros(self.nlp.numbers)

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves from the last plan, a sample later."""
        found = self._function(
            x0=later(self._plan, self.nlp.stage),
            lam_x0=later(self._multipliers, self.nlp.stage),
            p=p,
            lbx=self.nlp.low,
            ubx=self.nlp.high,
            lbg=0,
            ubg=0,
        )
        self._plan = np.array(found["x"]).ravel()
        self._multipliers = np.array(found["lam_x"]).ravel()
        return self._function.stats()["t_wall_total"], self._plan, self._multipliers


class Generated:
    """A CasADi solver that is generated to C, called and timed in C."""

    def __init__(self, nlp: Nlp, plugin: str, folder: Path, clock: Any) -> None:
        self.nlp = nlp
        self._library = compiled(made(nlp, plugin), plugin, folder)
        sizes = [ctypes.c_longlong() for _ in range(4)]
        self._library.solver_work(*map(ctypes.byref, sizes))
        self._clock = clock
        self._room = [np.zeros(sizes[2].value, np.int64), np.zeros(sizes[3].value)]
        rows = nlp.expressions["g"].shape[0]
        zero = np.zeros(rows)
        self._from = [
            np.zeros(nlp.numbers),
            np.zeros(nlp.expressions["p"].shape[0]),
            nlp.low,
            nlp.high,
            zero,
            zero,
            np.zeros(nlp.numbers),
            np.zeros(rows),
        ]
        lengths = (nlp.numbers, 1, rows, nlp.numbers, rows, len(self._from[1]))
        self._to = [np.zeros(n) for n in lengths]
        self._arguments = _pointers(self._from, sizes[0].value)
        self._results = _pointers(self._to, sizes[1].value)
        self._library.solver_incref()
        self._memory = self._library.solver_checkout()

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        for array in self._to:
            array[:] = 0

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves from the last plan with its multipliers, a sample later."""
        for place, result, size in ((0, 0, "stage"), (6, 3, "stage"), (7, 4, "rows")):
            self._from[place][:] = later(self._to[result], getattr(self.nlp, size))
        self._from[1][:] = p
        integers, numbers = (a.ctypes.data_as(ctypes.c_void_p) for a in self._room)
        seconds = self._clock(
            self._library.solver,
            self._arguments,
            self._results,
            integers,
            numbers,
            self._memory,
        )
        return seconds, self._to[0], self._to[3]


def made(nlp: Nlp, plugin: str, **options: Any) -> ca.Function:
    """The CasADi solver of a problem by a plugin such as `ipopt`."""
    own = QUIET | OPTIONS[plugin] | options
    if plugin == "fatrop":
        own["equality"] = [True] * nlp.expressions["g"].shape[0]
    return ca.nlpsol("solver", plugin, nlp.expressions, own)


def compiled(solver: ca.Function, plugin: str, folder: Path) -> Any:
    """Generates C of a solver and compiles it, with fatrop's library if the plugin is fatrop."""
    casadi = Path(ca.__file__).parent
    folder.mkdir(exist_ok=True)
    source = folder / f"{plugin}.c"
    generator = ca.CodeGenerator(source.name)
    generator.add(solver)
    generator.generate(f"{folder}/")
    libraries = [f"-L{casadi}", "-lfatrop", f"-Wl,-rpath,{casadi}"] if plugin == "fatrop" else []
    command = ["gcc", "-O2", "-shared", "-fPIC", str(source), f"-I{casadi / 'include'}"]
    program = folder / f"{plugin}.so"
    subprocess.run([*command, "-o", str(program), *libraries, "-lm"], check=True)
    return ctypes.CDLL(str(program))


def later(plan: Vector, stage: int) -> Vector:
    """The plan shifted by one sample; the last stage is repeated."""
    return np.concatenate([plan[stage:], plan[-stage:]])


def _pointers(arrays: list[Vector], count: int) -> Any:
    addresses = [array.ctypes.data for array in arrays] + [None] * (count - len(arrays))
    return (ctypes.c_void_p * count)(*addresses)
