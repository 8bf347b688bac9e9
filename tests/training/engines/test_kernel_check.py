"""The comparison of fresh kernels with the interpreter: silent on right ones, whatever the data."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from inspect import unwrap
from types import ModuleType

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from backends.native import kernel as kernel_module
from backends.native import rollout_kernel as rollout_module
from backends.native import sensitivity_kernel as sensitivity_module
from backends.native.kernel import Kernel
from backends.native.kernel_source import KernelSource
from backends.native.rollout_kernel import RolloutKernel
from backends.native.sensitivity_kernel import SensitivityKernel
from compiler.differentiation.sensitivities import Sensitivities, sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.kernel_check import (
    WrongKernelError,
    cases,
    check_kernel,
    check_sensitivities,
    compare,
)
from msnn.simulation.engines.native_rollouts import check_rollouts
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


@dataclass(frozen=True, slots=True)
class Fault:
    """A change of a kernel's C, and what the comparison says of it."""

    right: str
    wrong: str
    says: str
    model: str = "joints"

    def spoiled(self, text: str) -> str:
        """The text with the fault in it."""
        assert self.right in text
        return text.replace(self.right, self.wrong)


GRADIENT = "all->slopes[i] += slopes[i];"
SUM = "sums[l] += (double)sum_group("
COUNT = "counts[l] += (double)sum_group("
USED = "memcpy(&found.used, g->used + number * LANES, sizeof found.used);"
PRODUCT = "found[a][b] = fused(row[i + a], row[j + b], found[a][b]);"

# each shows in one of the numbers that are compared, or in one of the cases alone
FAULTS = {
    "a gradient a part in a thousand too small": Fault(
        GRADIENT, GRADIENT.replace(";", " * (real)0.999;"), "the slope in `a`", "plant"
    ),
    "a gradient that is no number": Fault(
        GRADIENT, GRADIENT.replace(";", " * (real)NAN;"), "the slope in `A` nan"
    ),
    "one element of a gradient": Fault(GRADIENT, f"if (i != 1) {GRADIENT}", "the slope in `A`"),
    "losses that all weigh alike": Fault("? weights[l]", "? weights[0]", "the slope in `A`"),
    "a sum that leaves lanes out": Fault(
        "quarter[0] + quarter[1];", "quarter[0];", "the loss `fit`"
    ),
    "lanes that count without a rollout": Fault(
        USED,
        USED.replace("memcpy", "memset").replace("g->used + number * LANES", "-1"),
        "the loss `fit`",
    ),
    "the sum of the second loss": Fault(SUM, f"if (l != 1) {SUM}", "the loss `size`"),
    "the elements of the first loss": Fault(COUNT, f"if (l) {COUNT}", "the elements of `fit`"),
    "steps that are not skipped": Fault("(size_t)p->skip", "0", "the loss `fit`"),
    "missing targets that count": Fault(
        "choose(scored, count[l]", "choose(scored, splat(ELEMENTS[l])", "the elements of `fit`"
    ),
    "missing targets that count, in data that miss none": Fault(
        "count[0U] = choose(", "count[0U] = splat(1) + choose(", "the elements of", "plant"
    ),
    "the last of eight steps at once": Fault(
        "row_5[t + 7U] =", "row_5[t + 7U] = splat(2) *", "the loss ", "fir"
    ),
}


@pytest.fixture
def spoil(monkeypatch: pytest.MonkeyPatch) -> Callable[[ModuleType, str, Fault], None]:
    """Puts a fault into what a function of a module writes."""

    def spoil(module: ModuleType, name: str, fault: Fault) -> None:
        right = getattr(module, name)

        def wrong(*args: object, **kwargs: object) -> object:
            made = right(*args, **kwargs)
            if isinstance(made, KernelSource):
                return replace(made, text=fault.spoiled(made.text))
            source = replace(made.source, text=fault.spoiled(made.source.text))
            return replace(made, source=source)

        monkeypatch.setattr(module, name, wrong)

    # no source that was kept stands in for one with a fault, or outlives its test
    for name in ("_source", "_source_of_losses"):
        monkeypatch.setattr(kernel_module, name, unwrap(vars(kernel_module)[name]))
    return spoil


Spoil = Callable[[ModuleType, str, Fault], None]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", FAULTS)
def test_a_wrong_kernel_is_found(name: str, dtype: Dtype, spoil: Spoil) -> None:
    fault = FAULTS[name]
    spoil(kernel_module, "kernel_source", fault)
    if fault.model == "plant":
        program, log, runs = close_loop(compiled(PLANT), ("p",)), plant_log(0.1), runs_of(2000, 50)
    else:
        text, closed = MODELS[fault.model]
        program = close_loop(compiled(text), closed)
        log, runs = log_of(program), runs_of(90, 12)
    kernel = Kernel(program, dtype)
    with pytest.raises(WrongKernelError, match=f"kernel {kernel.built.name} computes {fault.says}"):
        check_kernel(kernel, log, runs, initial(program))


@pytest.mark.parametrize(
    "fault", [FAULTS["the sum of the second loss"], FAULTS["missing targets that count"]]
)
def test_a_wrong_kernel_of_losses_alone_is_found(fault: Fault, spoil: Spoil) -> None:
    spoil(kernel_module, "losses_source", fault)
    text, closed = MODELS["joints"]
    program = close_loop(compiled(text), closed)
    kernel = Kernel(program, "float64", slopes=False)
    with pytest.raises(WrongKernelError, match=f"computes {fault.says}"):
        check_kernel(kernel, log_of(program), runs_of(90, 12), initial(program))


SUM_OF_SLOPES = "add_group(sums + l * each, &summed[0][l], LOSSES + 1, apart);"
COUNT_OF_SLOPES = "add_group(counts + l * each, &counted[0][l], LOSSES + 1, apart);"

FAULTS_OF_SLOPES = {
    "products of slopes": Fault(
        PRODUCT,
        PRODUCT.replace("row[i + a]", "row[i + a] * 0.9999"),
        "the slopes and residuals of `fit`",
    ),
    "products of the second loss": Fault(
        "add_row(&products[l], rows + r * WIDTH, scored[l]);",
        "add_row(&products[l], rows + (l ? 3 : r) * WIDTH, scored[l]);",
        "the slopes and residuals of `size`",
    ),
    "the sum of the second loss": Fault(
        SUM_OF_SLOPES, f"if (l != 1) {SUM_OF_SLOPES}", "the loss `size`"
    ),
    "the elements of the first loss": Fault(
        COUNT_OF_SLOPES, f"if (l) {COUNT_OF_SLOPES}", "the elements of `fit`"
    ),
    "steps that are not skipped": Fault("(size_t)p->skip", "0", "the loss `fit`"),
    "products of one rollout in those of the next": Fault(
        "products[l].sum += (size_t)LOSSES", "products[l].sum += (size_t)0 * LOSSES", "the slopes"
    ),
}


@pytest.mark.parametrize("name", FAULTS_OF_SLOPES)
def test_a_wrong_kernel_of_sensitivities_is_found(name: str, spoil: Spoil) -> None:
    fault = FAULTS_OF_SLOPES[name]
    spoil(sensitivity_module, "sensitivity_source", fault)
    found, kernel, log = second_order(fault.model)
    with pytest.raises(WrongKernelError, match=f"computes {fault.says}"):
        check_sensitivities(kernel, found, log, runs_of(90, 12), initial(found.program))


FAULTS_OF_ROLLOUTS = {
    "outputs of the first step": Fault(
        "to[i] = kept[i][l];", "to[i] = t ? kept[i][l] : 1;", "the output `q_next`"
    ),
    "the sum of the second loss": FAULTS["the sum of the second loss"],
    "the elements of the first loss": FAULTS["the elements of the first loss"],
    "steps that are not skipped": FAULTS["steps that are not skipped"],
}


@pytest.mark.parametrize("name", FAULTS_OF_ROLLOUTS)
def test_a_wrong_kernel_of_rollouts_is_found(name: str, spoil: Spoil) -> None:
    fault = FAULTS_OF_ROLLOUTS[name]
    spoil(rollout_module, "rollout_source", fault)
    text, closed = MODELS[fault.model]
    program = close_loop(compiled(text), closed)
    kernel = RolloutKernel(program)
    with pytest.raises(WrongKernelError, match=f"computes {fault.says}"):
        check_rollouts(kernel, log_of(program), runs_of(90, 12), initial(program))


@pytest.mark.parametrize(("factor", "is_found"), [(1.5, False), (3.0, True)])
def test_a_kernel_may_be_off_twice_what_rounding_explains(factor: float, is_found: bool) -> None:
    built = Kernel(close_loop(compiled(PLANT), ("p",)), "float64").built
    with pytest.raises(WrongKernelError) if is_found else nullcontext():
        compare(built, "a number", 1.0 + factor * 1e-3, 1.0, 1e-3)


def test_a_function_is_known_to_its_thirteenth_digit(spoil: Spoil) -> None:
    """The judge's bound of sin in float64 is 1e-14; the sine of an input has no other rounding."""
    spoil(rollout_module, "rollout_source", Fault("kept[i][l];", "kept[i][l] * (1 + 2e-13);", ""))
    program = compiled("inputs: {u: {}}\noutputs: {y: sin(u)}\n")
    with pytest.raises(WrongKernelError, match="computes the output `y`"):
        check_rollouts(RolloutKernel(program), log_of(program), runs_of(90, 12), {})


def test_marks_of_residuals_that_are_left_out_are_compared(spoil: Spoil) -> None:
    """√(|u| + k) at k 0 has infinite slopes where u is 0, which it never is here."""
    wrong = PRODUCT.replace(");", ") + (i + a == 2 && j + b == 2);")
    spoil(sensitivity_module, "sensitivity_source", Fault(PRODUCT, wrong, ""))
    program = compiled(
        "inputs: {u: {}}\ntargets: {z: {}}\nparameters: {k: 0}\n"
        "outputs: {y: {expr: sqrt(abs(u) + k), predicts: z}}\n"
    )
    found = sensitivities(with_compared_squares(program), ["k"])
    kernel, log = SensitivityKernel(found), log_of(program)
    with pytest.raises(WrongKernelError, match="computes the elements left out of"):
        check_sensitivities(kernel, found, log, runs_of(90, 12), initial(program))


def test_everybody_tries_the_same_rows_and_weights() -> None:
    """A kernel that is wrong is found wrong at every start, whatever else was drawn before."""
    text, closed = MODELS["joints"]
    program = close_loop(compiled(text), closed)
    first, second = (
        list(cases(program, log_of(program), runs_of(90, 12), initial(program), 19)) for _ in "ab"
    )
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.runs.t0, other.runs.t0)
        for name, values in one.runs.log.items():
            np.testing.assert_array_equal(values, other.runs.log[name])
        for name, value in one.weights.items():
            np.testing.assert_array_equal(value, other.weights[name])


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
