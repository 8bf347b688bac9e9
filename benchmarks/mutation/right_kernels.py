"""Counts correct kernels that the check of new kernels refuses by mistake."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from backends.native.kernel import Kernel
from backends.native.sensitivity_kernel import SensitivityKernel
from benchmarks.mutation.random_stages import RandomStage, random_stage
from compiler.differentiation.sensitivities import sensitivities
from msnn.model.load import load_model
from msnn.model.model_data import read_data
from msnn.model.weights.weights_file import initial_weights
from msnn.simulation.engines.kernel_check import WrongKernelError, check_kernel, check_sensitivities
from msnn.training.engines.native.native_squares import NativeSquares
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from tests.examples.gallery import NAMES, gallery_copy, spec_of


def alarms(seeds: Iterable[int]) -> int:
    """The number of correct kernels of random stages that the check refuses."""
    tried = refused = 0
    began = time.monotonic()
    for seed in seeds:
        stage = random_stage(seed)
        tried += 1
        try:
            check_stage(stage)
        except WrongKernelError as error:
            refused += 1
            print(f"  {seed}: {error}\n{stage.text}", flush=True)
    seconds = time.monotonic() - began
    print(f"{refused} of {tried} random stages refused, {seconds:.0f} s")
    return refused


def check_stage(stage: RandomStage) -> None:
    """Checks the kernel of a random stage, and its kernel of sensitivities if it has one."""
    kernel = Kernel(stage.program, stage.dtype)
    check_kernel(kernel, stage.log, stage.runs, stage.weights)
    if stage.second_order:
        found = sensitivities(stage.program, [p.name for p in stage.program.parameters])
        products = SensitivityKernel(found)
        check_sensitivities(products, found, stage.log, stage.runs, stage.weights)


def gallery(place: Path) -> int:
    """The number of kernels of the gallery that the check refuses, in both precisions and with
    sensitivities.
    """
    gallery_copy(place)
    refused = 0
    for name in NAMES:
        model = load_model(spec_of(place, name))
        (plan,) = plan_stages(model.program, model.spec.train, Findings())
        data, weights = read_data(model, None, "training"), initial_weights(model.program)
        found, log = stage_data(plan, data, Findings()), data.series
        assert found is not None
        try:
            for dtype in ("float32", "float64"):
                check_kernel(Kernel(plan.program, dtype), log, found.train, weights)
            squares = NativeSquares(plan, log, found.train_rows, found.watched_rows)
            squares.check(found.train, weights)
        except WrongKernelError as error:
            refused += 1
            print(f"  {name}: {error}", flush=True)
    print(f"{refused} of {len(NAMES)} models of the gallery refused")
    return refused
