"""The bounds of math functions, on which proofs stand, hold what the functions give."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.table import KERNELS
from msnn.cli.application import run
from msnn.verification.exported_c import read_exported_c
from msnn.verification.harness import write_harness
from msnn.verification.proof.assumptions import kernel_bounds
from msnn.verification.proof_step import GCC
from tests.verification.test_verify import require

SPEC = """
msnn: 1
name: all
sample_time: 1 s
inputs: {x: {range: [-1, 1]}, z: {range: [-1, 1]}}
outputs:
OUTPUTS
"""

INTERVALS = """
/* In place of Frama-C's header: one end of each interval. */
extern int upper;
int upper;
static double Frama_C_double_interval(double low, double high) { return upper ? high : low; }
"""

EVERYWHERE = [
    0.0,
    1e-30,
    1e-18,
    1e-12,
    1e-9,
    1e-7,
    1e-4,
    0.1,
    0.5,
    0.9999,
    1.0,
    1.5,
    2.0,
    3.0,
    6.5,
    20.0,
    88.0,
]
FAR = {"float32": [1e4, 3e38], "float64": [300.0, 700.0, 1e4, 1e300]}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_bounds_of_every_function_hold_its_values(dtype: str, tmp_path: Path) -> None:
    require(GCC)
    rows = {name: SCALAR_FUNCTIONS[name] for name in KERNELS}
    arguments = {name: "x, z" if name in ("pow", "atan2") else "x" for name in rows}
    outputs = "\n".join(f"  y_{name}: {name}({arguments[name]})" for name in rows)
    spec = tmp_path / "all.msnn.yaml"
    spec.write_text(SPEC.replace("OUTPUTS", outputs), encoding="utf-8")
    setting = f"export.c.dtype={dtype}"
    words = ["export", str(spec), "--initial", "--to", "c", "--out", str(tmp_path)]
    assert run([*words, "--set", setting]) == 0
    model = read_exported_c(tmp_path / "c")
    bodies = kernel_bounds(model)
    facts = {"values": [], "begun": [], "shown": [], "function": "step", "kernels": bodies}
    main = write_harness("eva_main.c", model, tmp_path, **facts)
    (tmp_path / "__fc_builtin.h").write_text(INTERVALS, encoding="utf-8")
    includes = [f"-I{place}" for place in (tmp_path, model.include, model.folder / "src")]
    flags = ["-std=gnu99", "-O0", "-w", "-fno-builtin", "-shared", "-fPIC"]
    sources = [path for path in model.model_sources if not path.stem.endswith("_math")]
    library = tmp_path / "bounds.so"
    subprocess.run(["gcc", *flags, *includes, main, *sources, "-o", library, "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))
    real = ctypes.c_float if dtype == "float32" else ctypes.c_double
    upper = ctypes.c_int.in_dll(loaded, "upper")
    number = np.dtype(dtype).type

    def bounds(function: Callable[..., float], given: tuple[float, ...]) -> list[float]:
        found: list[float] = []
        for end in (0, 1):
            upper.value = end
            found.append(function(*given))
        return sorted(found)

    points = [sign * size for size in EVERYWHERE + FAR[dtype] for sign in (1.0, -1.0)]
    seen: dict[str, int] = {}
    for name, row in rows.items():
        try:
            function = getattr(loaded, f"{model.prefix}_{name}")
        except AttributeError:
            continue  # an instruction of its own in C
        count = 2 if name in ("pow", "atan2") else 1
        function.argtypes, function.restype = [real] * count, real
        for given in product(points, repeat=count):
            rounded = tuple(float(number(value)) for value in given)
            with np.errstate(all="ignore"):
                exact = float(row.numpy(*(np.float64(value) for value in rounded)))
            # the assertion of a bound, or an alarm at the infinity, speaks of all others
            if not np.isfinite(exact) or abs(exact) > float(np.finfo(dtype).max):
                continue
            low, high = bounds(function, rounded)
            if name in ("sinh", "cosh") and not np.isfinite(high):
                continue  # e^|x| overflows just before half of it does
            # `near` moves both ends the same way; a number below all others is 0
            slack = 2e-6 * abs(exact) + float(np.finfo(dtype).tiny)
            assert low - slack <= exact <= high + slack, (name, given)
            seen[name] = seen.get(name, 0) + 1
    assert set(rows) - set(seen) <= {"sqrt"}
    assert min(seen.values()) >= 12
