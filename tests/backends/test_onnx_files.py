"""The files of an ONNX export pass the checker, run as their README says and are complete."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest

from backends.onnx_model.model import write_onnx
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Output, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.to_step_form import to_step_form
from tests.backends.readme_code import run_example
from tests.programs import SAMPLES


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", SAMPLES)
def test_models_pass_the_checker_and_the_readme_runs(name: str, dtype: type, tmp_path: Path):
    program = to_step_form(SAMPLES[name]().program)
    paths = write_onnx(program, None, tmp_path, "model", dtype)
    for path in paths[:-1]:
        onnx.checker.check_model(str(path), full_check=True)
        onnx.shape_inference.infer_shapes(onnx.load(path), strict_mode=True)
    assert program.outputs[0].name in run_example(paths[-1])


def test_a_program_without_states_has_two_models(tmp_path: Path):
    b = GraphBuilder()
    u = b.signal("u", 0, 0, Type())
    output = Output("y", b.add(u, u))
    nothing = GraphBuilder().graph()
    inputs = (Signal("u", Role.INPUT),)
    program = Program("gain", None, inputs, (), (), b.graph(), nothing, (output,))
    paths = write_onnx(program, None, tmp_path, "gain")
    assert [p.name for p in paths] == ["gain.onnx", "gain_rollout.onnx", "gain_onnx.md"]
    assert "initial_state" not in paths[2].read_text(encoding="utf-8")
    run_example(paths[2])


def test_a_wrong_weight_leaves_the_old_files(tmp_path: Path):
    program = to_step_form(SAMPLES["fir_closed_loop"]().program)
    paths = write_onnx(program, None, tmp_path, "fir")
    before = {path: path.read_bytes() for path in paths}
    with pytest.raises(ValueError, match=r"h\.weight"):
        write_onnx(program, {"h.weight": np.zeros(2)}, tmp_path, "fir")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
