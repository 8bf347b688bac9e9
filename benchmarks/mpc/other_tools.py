"""Times generated controllers beside other tools on the same problems, in one interleaved run.

    python benchmarks/mpc/other_tools.py [samples] [repetitions]

Needs other packages beside the locked ones, in a folder of their own on PYTHONPATH: `pip install
--no-deps --target DIR osqp==1.1.3 piqp==0.7.0 comma-deps-acados==0.2.2.post92`, less `DIR/casadi`,
which is for one version of Python and would stand before the locked one.
Each tool closes a loop of its own over the same disturbances (the network's plant) or the same
wishes and speeds (the filter's plant); all take their turn at every sample. A solve counts with the
shortest of its repetitions, and where a judge that knows no tool finds the optimality conditions to
1e-6; all others are failed. ipopt runs in CasADi's virtual machine, fatrop and sqpmethod with qrqp
as C that CasADi generates; of OSQP and PIQP only the solves of QPs are timed. acados solves the
network's problem alone: a filter of 30 samples is 30 states there.
"""

from __future__ import annotations

import ctypes
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import fir
import numpy as np
import run
from other_tools_acados import Acados
from other_tools_casadi import Generated, Interpreted
from other_tools_problems import (
    WINDOW,
    N,
    Nlp,
    Vector,
    network_problem,
    network_step,
    window_problem,
)
from other_tools_qp import Osqp, Piqp, Sequence

from msnn.features.control.backend.write_controller import write_controller
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.model.load import load_model
from msnn.tables import table_text

HERE = Path(__file__).resolve().parent
TOLERANCE = 1e-6


class Solver(Protocol):
    """A solver that starts from the plan of the previous sample."""

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        ...

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves for the parameters p.

        Returns seconds, the plan, and the multipliers of its bounds, positive at upper ones.
        """
        ...


@dataclass
class Contender:
    """A solver in a closed loop with its own copy of the plant."""

    name: str
    solver: Solver
    times: list[list[float]] = field(default_factory=list)
    failed: int = 0
    cost: float = 0
    p: Vector = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Loop:
    """A closed loop: the initial p, and the p after a sample with a control."""

    name: str
    first: Callable[[], Vector]
    after: Callable[[Vector, Vector, int], tuple[Vector, float]]


class Own:
    """The controller that msnn generates, called and timed in C."""

    def __init__(self, nlp: Nlp, library: Any) -> None:
        self._library = library
        self._plan = np.zeros(nlp.numbers)
        self._multipliers = np.zeros(nlp.numbers)

    def begin(self) -> None:
        """Forgets the plan of the previous sample."""
        self._library.begin()

    def solve(self, p: Vector) -> tuple[float, Vector, Vector]:
        """Solves from the last plan, shifted by one sample."""
        status = ctypes.c_int()
        arrays = (_address(a) for a in (p, self._plan, self._multipliers))
        seconds = self._library.own(*arrays, ctypes.byref(status))
        if status.value != 0:
            return seconds, self._plan * np.nan, self._multipliers
        return seconds, self._plan, self._multipliers


def main() -> None:
    """Generates, compiles, closes the loops and prints."""
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        for name in ("mlp", "fir"):
            folder = Path(place) / name
            folder.mkdir()
            weights: dict[str, Vector] = run.network_weights() if name == "mlp" else fir._weights()
            nlps = _problems(name, weights)
            library = _library(name, weights, folder)
            contenders = _contenders(nlps, library, folder)
            if name == "mlp":
                contenders += _of_acados(nlps["stages called"], weights, folder)
            for loop in _network_loops(library) if name == "mlp" else _window_loops(library):
                rows += _compare(loop, contenders, library, samples, repetitions)
    header = ("loop", "tool", "median us", "by ours", "p99", "longest", "failed", "cost")
    print(table_text(header, rows, numbers=list(range(2, 8))))
    print(f"{samples} samples; `failed`: not optimal to {TOLERANCE:g}; OSQP, PIQP: their QPs alone")


def _library(name: str, weights: dict[str, Vector], folder: Path) -> Any:
    problem = load_model(HERE / f"{name}.msnn.yaml").of(ControlProblem)
    assert problem is not None
    write_controller(problem, weights, folder / "plant", prefix="plant", dtype="float64")
    if name == "fir":
        about = json.loads((folder / "plant" / "plant_mpc.json").read_text())
        first, *_, last = about["plan"]["places"]
        (folder / "plan.h").write_text(f"enum {{ PLAN_Y = {first}, PLAN_U = {last} }};\n")
    program = folder / "own.so"
    sources = [str(path) for path in (folder / "plant" / "src").glob("*.c")]
    command = ["gcc", "-std=c99", *run.FLAGS, "-shared", "-fPIC", f"-I{folder}"]
    command += [f"-I{folder / 'plant' / 'include'}", str(HERE / f"other_tools_{name}.c")]
    subprocess.run([*command, *sources, "-o", str(program), "-lm"], check=True)
    library = ctypes.CDLL(str(program))
    for function in (library.own, library.off_by, library.timed):
        function.restype = ctypes.c_double
    return library


def _problems(name: str, weights: dict[str, Vector]) -> dict[str, Nlp]:
    if name == "mlp":
        return {"stages called": network_problem(network_step(weights))}
    return {
        "written out": window_problem(weights, is_called=False),
        "stages called": window_problem(weights, is_called=True),
    }


def _contenders(nlps: dict[str, Nlp], library: Any, folder: Path) -> list[Contender]:
    def judge(p: Vector, plan: Vector, multipliers: Vector) -> float:
        return library.off_by(_address(p), _address(plan), _address(multipliers))

    nlp = next(iter(nlps.values()))
    contenders = [Contender("controller of the spec", Own(nlp, library))]
    if nlp.name == "mlp":
        solver = Generated(nlp, "fatrop", folder, library.timed)
        contenders.append(Contender("fatrop in C", solver))
    for form, own in nlps.items():
        solver = Generated(own, "sqpmethod", folder / form.replace(" ", "_"), library.timed)
        contenders.append(Contender(f"sqpmethod + qrqp in C, {form}", solver))
    contenders.append(Contender("ipopt", Interpreted(nlp, "ipopt", expand=True)))
    contenders.append(Contender("QPs of OSQP", Sequence(nlp, Osqp(), judge)))
    contenders.append(Contender("QPs of PIQP", Sequence(nlp, Piqp(), judge)))
    return contenders


def _of_acados(nlp: Nlp, weights: dict[str, Vector], folder: Path) -> list[Contender]:
    step = network_step(weights)
    return [
        Contender(f"acados, {way}", Acados(nlp, step, f"{way.upper()}_CONDENSING_HPIPM", folder))
        for way in ("partial", "full")
    ]


def _network_loops(library: Any) -> list[Loop]:
    text = (HERE / "prototypes" / "w.h").read_text()
    found = re.search(r"\bDIST2\[\d+\]=\{([^}]*)\}", text)
    assert found is not None
    draws = np.array([float(x) for x in found[1].split(",")]).reshape(-1, 2)

    def after(p: Vector, plan: Vector, t: int) -> tuple[Vector, float]:
        x = _next(library, p, float(plan[2]), 2) + draws[t]
        cost = float(x @ x)
        if abs(x[0]) > 4 or abs(x[1]) > 6:
            x = np.array([1.2, 0.0])
        return x, cost

    return [Loop("mlp, disturbed", lambda: np.array([1.2, 0.0]), after)]


def _window_loops(library: Any) -> list[Loop]:
    def wanted(t: int, is_hard: bool) -> float:
        return (3.0 if (t // 25) % 2 else -3.0) if is_hard else 0.5 * np.sin(t * 0.15)

    def known(t: int, is_hard: bool) -> list[float]:
        return [15 + 5 * np.sin(t * 0.1), *(wanted(t + k, is_hard) for k in range(N + 1))]

    def loop(name: str, is_hard: bool) -> Loop:
        def after(p: Vector, plan: Vector, t: int) -> tuple[Vector, float]:
            u = float(plan[1])
            y = float(_next(library, p, u, 1)[0])
            past = [*p[2:WINDOW], u]
            return np.array([y, *past, *known(t + 1, is_hard)]), (y - wanted(t + 1, is_hard)) ** 2

        return Loop(name, lambda: np.array([0.0] * WINDOW + known(0, is_hard)), after)

    return [loop("fir, sine", False), loop("fir, steps of 3", True)]


def _compare(
    loop: Loop, contenders: list[Contender], library: Any, samples: int, repetitions: int
) -> list[tuple[str, ...]]:
    for contender in contenders:
        contender.times = []
    for _ in range(repetitions):
        for contender in contenders:
            contender.solver.begin()
            contender.p, contender.cost, contender.failed = loop.first(), 0.0, 0
            contender.times.append([])
        for t in range(samples):
            for contender in contenders:
                _sample(contender, loop, library, t)
    rows: list[tuple[str, ...]] = []
    first = 0.0
    for contender in contenders:
        times = np.sort(np.min(contender.times, axis=0)) * 1e6
        median = float(np.median(times))
        first = first or median
        numbers = (times[int(0.99 * samples)], times[-1])
        cells = [f"{median:.1f}", f"{median / first:.2f}", *(f"{x:.1f}" for x in numbers)]
        rows.append(
            (loop.name, contender.name, *cells, str(contender.failed), f"{contender.cost:.4f}")
        )
    return rows


def _sample(contender: Contender, loop: Loop, library: Any, t: int) -> None:
    p = contender.p
    seconds, plan, multipliers = contender.solver.solve(p)
    contender.times[-1].append(seconds)
    off_by = library.off_by(_address(p), _address(plan), _address(multipliers))
    contender.failed += not off_by <= TOLERANCE
    applied = np.where(np.isfinite(plan), np.clip(plan, -20, 20), 0)
    contender.p, cost = loop.after(p, applied, t)
    contender.cost += cost


def _next(library: Any, p: Vector, u: float, size: int) -> Vector:
    after = np.zeros(size)
    library.next_state(_address(p), ctypes.c_double(u), _address(after))
    return after


def _address(array: Vector) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


if __name__ == "__main__":
    main()
