"""Measures how far first controls of float32 are from those of float64, at the same 2,000 samples.

    python benchmarks/mpc/float32.py

Both controllers of `mlp.msnn.yaml` and of `fir.msnn.yaml` follow the closed loop that the one in
float64 closes, each from its own plan; float32 solves to 1e-3. All boards give the bits of the host
(decision 0268), so that the distances are those of a Cortex-M4F and M7.
"""

from __future__ import annotations

import ctypes
import re
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import fir
import numpy as np
import run
from numpy.typing import NDArray

from msnn.features.control.backend.write_controller import write_controller
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.model.load import load_model
from msnn.tables import table_text

HERE = Path(__file__).resolve().parent
SAMPLES = 2000
WINDOW = 30
N = 20
Vector = NDArray[np.float64]


class Controller:
    """An exported controller, compiled in float32 or float64."""

    def __init__(
        self, problem: ControlProblem, weights: dict[str, Vector], dtype: str, folder: Path
    ) -> None:
        write_controller(problem, weights, folder, prefix="plant", dtype=dtype)
        program = folder / "own.so"
        sources = [str(path) for path in (folder / "src").glob("*.c")]
        command = ["gcc", "-std=c99", *run.FLAGS, "-shared", "-fPIC", f"-I{folder / 'include'}"]
        subprocess.run([*command, *sources, "-o", str(program)], check=True)
        self._library = ctypes.CDLL(str(program))
        self._dtype = np.dtype(dtype)
        # more than the struct takes in either kind of numbers
        self._memory = np.zeros(1 << 17)
        self._library.plant_mpc_init(_address(self._memory))

    def solve(self, given: list[float]) -> tuple[int, float, float]:
        """Solves for measured values in the order of the input; returns status, control and
        residual.
        """
        numbers = np.array(given, self._dtype)
        out = np.zeros(8, self._dtype)
        arrays = (_address(a) for a in (self._memory, numbers, out))
        return self._library.plant_mpc_solve(*arrays), float(out[0]), float(out[1])


def main() -> None:
    """Follows both loops and prints."""
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        for name, follow in (("mlp", _network), ("fir", _window)):
            problem = load_model(HERE / f"{name}.msnn.yaml").of(ControlProblem)
            assert problem is not None
            weights: dict[str, Vector] = run.network_weights() if name == "mlp" else fir._weights()
            exact = Controller(problem, weights, "float64", Path(place) / f"{name}64")
            coarse = replace(problem, tolerance=1e-3)
            short = Controller(coarse, weights, "float32", Path(place) / f"{name}32")
            found = np.array(follow(weights, exact, short))
            off = np.abs(found[:, 1] - found[:, 4])
            middle, most = float(np.median(off)), float(off.max())
            far = int(np.sum(off > 0.03))
            solved = (int(np.sum(found[:, i] == 0)) for i in (0, 3))
            cells = (f"{middle:.1e}", f"{np.quantile(off, 0.99):.1e}", f"{most:.1e}", str(far))
            left = f"{float(np.median(found[:, 5])):.1e}"
            rows.append((name, *cells, *map(str, solved), left))
    header = (
        "plant",
        "median",
        "p99",
        "largest",
        "beyond 0.03",
        "solved, float64",
        "float32",
        "residual",
    )
    print(table_text(header, rows, numbers=list(range(1, 8))))
    print(f"distance of first controls, which are between -3 and 3, at {SAMPLES} samples")


def _network(weights: dict[str, Vector], exact: Controller, short: Controller) -> list[Any]:
    text = (HERE / "prototypes" / "w.h").read_text()
    found = re.search(r"\bDIST2\[\d+\]=\{([^}]*)\}", text)
    assert found is not None
    draws = np.array([float(x) for x in found[1].split(",")]).reshape(-1, 2)
    x = np.array([1.2, 0.0])
    results: list[Any] = []
    for t in range(SAMPLES):
        one, other = exact.solve(x.tolist()), short.solve(x.tolist())
        results.append((*one, *other))
        inner = np.array([*x, one[1]])
        for layer in ("1", "2"):
            inner = np.tanh(weights[f"net.weight{layer}"] @ inner + weights[f"net.bias{layer}"])
        x = x + weights["net.weight3"] @ inner + weights["net.bias3"] + draws[t]
        if abs(x[0]) > 4 or abs(x[1]) > 6:
            x = np.array([1.2, 0.0])
    return results


def _window(weights: dict[str, Vector], exact: Controller, short: Controller) -> list[Any]:
    """The results of both controllers along a loop whose reference jumps between 3 and −3.

    Half of these jumps reach the bounds of the control.
    """

    def wanted(t: int) -> float:
        return 3.0 if (t // 25) % 2 else -3.0

    y, past = 0.0, [0.0] * (WINDOW - 1)
    results: list[Any] = []
    for t in range(SAMPLES):
        speed = 15 + 5 * np.sin(t * 0.1)
        given = [y, *past, speed, *(wanted(t + k) for k in range(N + 1))]
        one, other = exact.solve(given), short.solve(given)
        results.append((*one, *other))
        inside = np.maximum(0, 1 - np.abs(speed - np.array([5, 15, 25])) / 10)
        seen = np.array([*past, one[1]])
        own = weights["a"] * y + weights["local.weight"] @ seen
        y = float(inside @ own + 0.02 * np.tanh(y))
        past = [*past[1:], one[1]]
    return results


def _address(array: NDArray[Any]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


if __name__ == "__main__":
    main()
