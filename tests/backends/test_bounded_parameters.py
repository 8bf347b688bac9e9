"""No rounding takes a parameter past its bounds, whatever its raw variable is."""

from __future__ import annotations

import ctypes
import math
from pathlib import Path

import numpy as np
import pytest
import torch

import msnn
from backends.c_language.literals import Dtype
from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_source import kernel_source
from backends.native.variables import Method, Rule, Variables
from backends.raw_parameters import physical_slope, physical_value
from backends.torch_module import module
from compiler.differentiation.training_step import training_step
from compiler.ir.program import Parameter
from msnn.model.weights.weights_file import read_weights, weights_path
from tests.conditions import require_tool
from tests.language.compiled import compiled

KNOWN = [
    (-1.0, 1.6),
    (-1e9, 1e-7),
    (-1000.0, 0.001),
    (-0.3, 0.0),
    (0.0, 0.3),
    (1e6, 1e6 + 1e-8),
    (1.0, math.nextafter(1.0, 2.0)),
    (-1e300, 1e-300),
    (5e-324, 1e-323),
]
"""Ranges beside which a bound, or all of the range, is small."""
RAWS = np.array([-np.inf, -800.0, -40.0, -17.0, -1.0, -0.0, 1e-300, 0.3, 17.0, 40.0, 800.0, np.inf])


def pairs(count: int) -> list[tuple[float, float]]:
    """The known ones, and as many drawn ones of all magnitudes."""
    random = np.random.default_rng(7)
    ends = random.choice([-1.0, 1.0], (count, 2)) * 10.0 ** random.uniform(-9, 9, (count, 2))
    return KNOWN + [(float(low), float(high)) for low, high in np.sort(ends) if low < high]


def bounded(low: float, high: float) -> Parameter:
    return Parameter("p", initial=(low,), minimum=low, maximum=high)


def raws(seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(0.0, 20.0, 200)
    return np.concatenate([RAWS, drawn])


def test_the_map_ends_on_its_bounds_and_stays_between_them() -> None:
    for number, (low, high) in enumerate(pairs(3000)):
        found = physical_value(bounded(low, high), raws(number))
        assert (found[0], found[RAWS.size - 1]) == (low, high)
        assert np.all((low <= found) & (found <= high)), (low, high)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_torch_stays_between_the_bounds_as_its_type_has_them(dtype: torch.dtype) -> None:
    for number, (low, high) in enumerate(pairs(1000)):
        raw = torch.tensor(raws(number), dtype=dtype)
        found = module.physical_value(bounded(low, high), raw)
        ends = torch.tensor([low, high], dtype=dtype)
        if torch.isfinite(ends[1] - ends[0]):
            assert torch.all((ends[0] <= found) & (found <= ends[1])), (low, high)


def test_slopes_of_torch_are_those_of_the_kernels_on_both_sides() -> None:
    for low, high in KNOWN[:5]:
        variable = torch.tensor(RAWS[1:-1], dtype=torch.float64, requires_grad=True)
        module.physical_value(bounded(low, high), variable).sum().backward()
        wanted = physical_slope(bounded(low, high), RAWS[1:-1])
        assert variable.grad is not None
        np.testing.assert_allclose(variable.grad.numpy(), wanted, rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_kernel_has_the_numbers_of_numpy(dtype: Dtype) -> None:
    require_tool("gcc", install="apt install gcc")
    # the value of a spec lies inside its bounds, and single precision has them
    chosen = [(a, b) for a, b in pairs(30) if math.nextafter(a, b) < b and a > -1e30]
    entries = ", ".join(
        f"p{number}: {{init: {math.nextafter(low, high)!r}, min: {low!r}, max: {high!r}}}"
        for number, (low, high) in enumerate(chosen)
    )
    total = " + ".join(f"p{number}" for number, _ in enumerate(chosen))
    program = compiled(
        f"inputs: {{u: {{}}}}\ntargets: {{y: {{}}}}\nparameters: {{{entries}}}\n"
        f"outputs: {{out: {{expr: 'u * ({total})', predicts: 'y[t]'}}}}\n"
    )
    library = compiled_kernel(kernel_source(training_step(program), dtype).text).library
    variables = Variables(
        program=program,
        dtype=np.dtype(dtype),
        rule=Rule(method=Method.SGD),
        weights={p.name: np.array(p.initial[0]) for p in program.parameters},
        rates={p.name: 1.0 for p in program.parameters},
    )
    for raw in raws(0).astype(dtype):
        variables.arrays["raw"][:] = raw
        library.msnn_physical(ctypes.byref(variables.addresses))
        wanted = [physical_value(p, np.array(raw, np.float64)) for p in program.parameters]
        with np.errstate(over="ignore"):
            assert variables.arrays["physical"].tobytes() == np.array(wanted, dtype).tobytes()


SPEC = """msnn: 1
name: pushed
sample_time: 10 ms
inputs: {u: {}}
targets: {y: {}}
parameters:
  a: {init: 0, min: -1000, max: 0.001}
  b: {init: 0, min: -1.0e+9, max: 1.0e-7}
  c: {init: 1, min: 0.001, max: 1000}
  d: {init: 1, min: 1.0e-7, max: 1.0e+9}
outputs: {out: {expr: "(a + b - c - d) * u", predicts: "y[t]"}}
data: {source: {train: log.csv}}
train: [{epochs: 12, %sengine: %s, optimizer: %s}]
"""


@pytest.mark.parametrize(
    ("dtype", "optimizer"),
    [
        ("dtype: float32, ", "{adam: {lr: 1000}}"),
        ("dtype: float64, ", "{adam: {lr: 1000}}"),
        ("", "levenberg_marquardt"),
    ],
    ids=["float32", "float64", "levenberg_marquardt"],
)
@pytest.mark.parametrize("engine", ["native", "torch"])
def test_weights_that_were_pushed_to_their_bounds_are_read_again(
    engine: str, dtype: str, optimizer: str, tmp_path: Path
) -> None:
    """E1119 is for weights of others: a training never ends outside of its own bounds."""
    require_tool("gcc", install="apt install gcc")
    rows = "\n".join(f"{k % 7 - 3},{(k % 7 - 3) * 1e6}" for k in range(60))
    (tmp_path / "log.csv").write_text(f"u,y\n{rows}\n", encoding="utf-8")
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SPEC % (dtype, engine, optimizer), encoding="utf-8")
    result = msnn.train(msnn.load(spec), runs=tmp_path / "runs")
    assert result.folder is not None
    program = msnn.load(result.folder).program
    read = read_weights(weights_path(result.folder), program)
    found = {name: float(value) for name, value in read.items()}
    ends = {p.name: p.maximum if p.name in "ab" else p.minimum for p in program.parameters}
    type = np.float32 if "float32" in dtype else np.float64
    assert found == {name: float(type(end)) for name, end in ends.items()}


HELD = """msnn: 1
name: held
sample_time: 10 ms
inputs: {u: {}}
targets: {y: {}}
parameters:
  a: {init: 0, min: 0}
  b: 1
outputs: {out: {expr: "b * u + 1.0e+7 * a", predicts: "y[t]"}}
data: {source: {train: log.csv}}
train:
  - {epochs: 1, batch: 60, engine: %s, dtype: float64, lr: {a: 0}, optimizer: {sgd: {lr: 0.01}}}
"""


def test_a_value_on_its_bound_that_is_not_trained_stays_there_in_both_engines(
    tmp_path: Path,
) -> None:
    """Off its bound by 1e-6 it was another model for torch."""
    require_tool("gcc", install="apt install gcc")
    rows = "\n".join(f"{k % 7 - 3},{k % 7 - 3}" for k in range(60))
    (tmp_path / "log.csv").write_text(f"u,y\n{rows}\n", encoding="utf-8")
    spec = tmp_path / "m.msnn.yaml"
    for engine in ("native", "torch"):
        spec.write_text(HELD % engine, encoding="utf-8")
        result = msnn.train(msnn.load(spec), runs=tmp_path / "runs")
        assert {name: float(value) for name, value in result.weights.items()} == {"a": 0, "b": 1}
