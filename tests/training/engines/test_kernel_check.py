"""The comparison of fresh kernels with the interpreter: silent on right ones, whatever the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from backends.native import kernel as kernel_module
from backends.native.kernel import Kernel
from backends.native.kernel_source import KernelSource
from backends.native.rollouts import sensitivity_kernel as sensitivity_module
from backends.native.rollouts.sensitivity_kernel import SensitivityKernel
from backends.native.rollouts.sensitivity_source import SensitivitySource
from compiler.differentiation.sensitivities import Sensitivities, sensitivities
from compiler.differentiation.training_step import TrainingStep
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_trials import WrongKernelError, cases
from msnn.training.engines.native.kernel_check import check_kernel, check_sensitivities
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of
from tests.native.test_sensitivity_kernel import SQUARED, squared

Log = dict[str, FloatArray]

PLANT = """
inputs: {p: {}, u: {}}
parameters: {a: 0.95, b: 1, c: 5000}
outputs: {p_next: {expr: "a*p + b*u + c", predicts: "p[t+1]"}}
"""
SMALL_SLOPE = """
inputs: {u: {}}
targets: {z: {}}
parameters: {k: 1}
outputs: {y: {expr: "0.001 * sin(k * u)", predicts: "z"}}
"""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


def runs_of(rows: int, steps: int) -> Runs:
    t0 = np.arange(10, rows - steps - 5)
    return Runs(t0, np.full(len(t0), steps), 0, rows)


def plant_log(noise: float) -> Log:
    """p near 1e5 that moves by some hundreds."""
    random = np.random.default_rng(0)
    u, p = random.normal(0, 200, 2000), np.full(2000, 1e5)
    for t in range(1999):
        p[t + 1] = 0.95 * p[t] + u[t] + 5000 + random.normal() * noise
    return {"p": p, "u": u}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("noise", [5.0, 0.1, 0.0])
def test_residuals_far_below_the_signal_are_no_mistake(dtype: Dtype, noise: float) -> None:
    """Signals of 1e5 in float32 are known to 4e-3: the loss has few digits or none."""
    program = close_loop(compiled(PLANT), ("p",))
    kernel = Kernel(program, dtype)
    check_kernel(kernel, plant_log(noise), runs_of(2000, 50), initial(program))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_slopes_far_below_the_loss_are_no_mistake(dtype: Dtype) -> None:
    random = np.random.default_rng(0)
    u = random.uniform(-2, 2, 2000)
    log = {"u": u, "z": np.sin(1.5 * u) + 0.7 * random.normal(size=2000)}
    program = compiled(SMALL_SLOPE)
    check_kernel(Kernel(program, dtype), log, runs_of(2000, 1), initial(program))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MODELS)
def test_every_model_passes(name: str, dtype: Dtype) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    check_kernel(Kernel(program, dtype), log_of(program), runs_of(90, 12), initial(program))


@pytest.mark.parametrize("name", SQUARED)
def test_every_kernel_of_sensitivities_passes(name: str) -> None:
    found, kernel, log = second_order(name)
    check_sensitivities(kernel, found, log, runs_of(90, 12), initial(found.program))


def second_order(name: str) -> tuple[Sensitivities, SensitivityKernel, Log]:
    program = squared(name)
    found = sensitivities(program, [p.name for p in program.parameters])
    return found, SensitivityKernel(found), log_of(program)


Log_of = Callable[[Program], Log]


def beyond_float32(program: Program) -> Log:
    return {name: values * 1e30 for name, values in log_of(program).items()}


def without_targets(program: Program) -> Log:
    return {
        name: np.full_like(values, np.nan) if name == "z" else values
        for name, values in log_of(program).items()
    }


def of_zeros(program: Program) -> Log:
    return {name: np.zeros_like(values) for name, values in log_of(program).items()}


@pytest.mark.parametrize("logged", [beyond_float32, without_targets, of_zeros])
@pytest.mark.parametrize("name", ["arm", "fir", "learned_start"])
def test_what_is_not_finite_or_zero_is_no_mistake(name: str, logged: Log_of) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    check_kernel(Kernel(program, "float32"), logged(program), runs_of(90, 12), initial(program))


CHANGES = {
    "a gradient a part in a thousand too small": (
        "all->slopes[i] += slopes[i];",
        "all->slopes[i] += slopes[i] * (real)0.999;",
    ),
    "a sum that leaves a lane out": ("half[0] += half[1];", ""),
    "steps that are not skipped": ("p->skip", "0"),
    "missing targets that count, in data that miss none": (
        "count[0U] = choose(",
        "count[0U] = splat(1) + choose(",
    ),
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("change", CHANGES)
def test_a_wrong_kernel_is_found(
    change: str, dtype: Dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = kernel_module.kernel_source

    def wrong(step: TrainingStep, dtype: Dtype, *, reproducible: bool, lbfgs: bool) -> KernelSource:
        made = right(step, dtype, reproducible=reproducible, lbfgs=lbfgs)
        text = made.text.replace(*CHANGES[change])
        assert text != made.text
        return replace(made, text=text)

    monkeypatch.setattr(kernel_module, "kernel_source", wrong)
    program = close_loop(compiled(PLANT), ("p",))
    kernel = Kernel(program, dtype)
    with pytest.raises(WrongKernelError, match=f"kernel {kernel.built.name} computes"):
        check_kernel(kernel, plant_log(0.1), runs_of(2000, 50), initial(program))


def test_a_wrong_kernel_of_sensitivities_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    right = sensitivity_module.sensitivity_source

    def wrong(found: Sensitivities) -> SensitivitySource:
        made = right(found)
        text = made.source.text.replace(
            "found[a][b] = fused(row[i + a], row[j + b], found[a][b]);",
            "found[a][b] = fused(row[i + a] * 0.9999, row[j + b], found[a][b]);",
        )
        return replace(made, source=replace(made.source, text=text))

    monkeypatch.setattr(sensitivity_module, "sensitivity_source", wrong)
    found, kernel, log = second_order("arm")
    with pytest.raises(WrongKernelError, match="slopes and residuals"):
        check_sensitivities(kernel, found, log, runs_of(90, 12), initial(found.program))


def test_drawn_rows_lie_beside_the_corners_of_fuzzy_sets() -> None:
    """A corner that is a tenth of a set wrong shows only where a number falls between."""
    text, closed = MODELS["vehicle"]
    program = close_loop(compiled(text), closed)
    log = {name: np.sign(values) * 0.9 for name, values in log_of(program).items()}
    *_, drawn = cases(program, log, runs_of(90, 12), initial(program), 19)
    values = drawn.runs.log["v"]
    for corner in (-0.33333334, 0.33333334):
        assert np.sum(np.abs(values - corner) < 0.1) > 2


def test_rows_of_a_model_that_compares_nothing_are_those_of_the_data() -> None:
    text, closed = MODELS["filtered_joints"]
    program = close_loop(compiled(text), closed)
    log = log_of(program)
    *_, drawn = cases(program, log, runs_of(90, 12), initial(program), 19)
    known = drawn.runs.log["u"]
    assert np.isin(known, log["u"]).all()
