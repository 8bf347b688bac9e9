"""Setting the states of built C, in every way in which it keeps them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.host.build import build_library
from backends.c.host.library import CStep
from backends.c_lowering.options import Ring
from backends.ports.step_interface import step_interface
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import write_library
from tests.conditions import require_tool
from tests.programs import SAMPLES


@pytest.mark.parametrize("ring", ["shift", "double"])
@pytest.mark.parametrize("sample", ["fir_closed_loop", "joint_arm", "late_sensor"])
def test_states_that_are_set_are_there_and_act(sample: str, ring: Ring, tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    program = SAMPLES[sample]().program
    program = to_step_form(prune_outputs(program, [output.name for output in program.outputs]))
    write_library(program, tmp_path, COptions(dtype="float64", ring=ring))
    library = build_library(tmp_path, tmp_path / "model.so")
    one, other = CStep.of_folder(tmp_path, library), CStep.of_folder(tmp_path, library)
    random = np.random.default_rng(0)
    for model in (one, other):
        model.init()
    values = {name: random.normal(size=value.shape) for name, value in one.states().items()}
    inputs = {
        port.signal.name: random.normal(size=port.type.shape)
        for port in step_interface(program).inputs
    }
    one.step(inputs)  # no state waits for its first sample any more
    one.set_states(values)
    assert all(np.array_equal(values[name], found) for name, found in one.states().items())
    # from the middle of a ring the same states mean the same
    for _ in range(3):
        other.step(inputs)
    other.set_states(values)
    for _ in range(5):
        first, second = one.step(inputs)[0], other.step(inputs)[0]
        assert all(np.array_equal(first[name], second[name]) for name in first)
