"""The lane versions of the math kernels against their numpy evaluation."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from backends.native.compile_kernel import compiled_kernel
from backends.native.lane_kernels import lane_kernels
from compiler.kernels.table import KERNELS, evaluate
from compiler.kernels.tables.formats import DOUBLE, FLOAT
from tests.conditions import require_tool

PRELUDE = Path(__file__).parents[2] / "templates" / "native" / "prelude.c"
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-30, -1e-30, 3e5, -7e6, 88.0, -104.0]


def source(name: str, dtype: str) -> str:
    kernel = KERNELS[name]
    arguments = ", ".join(f"a{i}[k]" for i in range(kernel.arity))
    declared = ", ".join(f"const lanes *a{i}" for i in range(kernel.arity))
    return "\n".join(
        [
            f"#define MSNN_DOUBLE {int(dtype == 'float64')}",
            PRELUDE.read_text(encoding="utf-8"),
            lane_kernels([name], DOUBLE if dtype == "float64" else FLOAT, "msnn"),
            f"void apply({declared}, lanes *out, int64_t numbers)",
            "{ for (int64_t k = 0; k < numbers / LANES; k++)",
            f"{{ out[k] = msnn_{name}({arguments}); }} }}",
        ]
    )


def aligned(values: np.ndarray) -> np.ndarray:
    raw = np.zeros(values.nbytes + 64, np.uint8)
    offset = -raw.ctypes.data % 64
    view = raw[offset : offset + values.nbytes].view(values.dtype)
    view[:] = values
    return view


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", sorted(KERNELS))
def test_lane_kernel(name: str, dtype: Literal["float32", "float64"]) -> None:
    require_tool("gcc", install="apt install gcc")
    random = np.random.default_rng(3)
    kernel = KERNELS[name]
    arguments = []
    for _ in range(kernel.arity):
        wide = random.normal(size=1600) * 10.0 ** random.uniform(-6, 2, 1600)
        values = np.concatenate([np.array(SPECIAL), wide])[:1600]
        random.shuffle(values)
        arguments.append(aligned(values.astype(dtype)))
    expected = evaluate(name, *arguments)
    found = aligned(np.zeros(1600, dtype))
    library = compiled_kernel(source(name, dtype), on_lanes=True).library
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*arguments, found)]
    library.apply(*pointers, ctypes.c_int64(1600))
    # fused and regrouped operations: a few units in the last place, more where words cancel
    tolerance = 4e-6 if dtype == "float32" else 1e-14
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-37)
