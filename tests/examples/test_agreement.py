"""Every target computes both examples as the interpreter does, along whole records.

One step from the judge's states within 1e-12 in float64, a free run of 1,000 steps within 1e-9
(both systems are damped), and C in float32 without one differing bit in 2,000 closed-loop steps.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judgement import AgreementRecord, FloatType
from msnn.data.reading.load import load_data
from msnn.data.rollout_rows import reach
from msnn.model.load import load_model
from msnn.training.train import TrainingOptions, train
from tests.agreement.exported import checked, plan_of
from tests.conditions import require_tool

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "mass_spring_damper"
DRONE = ROOT / "benchmarks" / "quarter_drone" / "drone_arm.msnn.yaml"
DRONE_DATA = ROOT.parent / "shared" / "data" / "quarter_drone"
FREE_RUN = 1e-9
STEPS = 2000


@dataclass(frozen=True)
class Trained:
    """A model's closed loop, its trained weights, and its longest measured record repeated."""

    program: Program
    weights: dict[str, np.ndarray]
    record: AgreementRecord


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's specs with the data that its generator makes, and the drone's spec."""
    place = tmp_path_factory.mktemp("examples")
    for spec in ("msd.msnn.yaml", "msd_physical.msnn.yaml"):
        shutil.copy(EXAMPLE / spec, place)
    generator = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", str(place / "data")]
    subprocess.run(generator, check=True, capture_output=True)
    if DRONE_DATA.is_dir():
        shutil.copy(DRONE, place)
        shutil.copy(DRONE_DATA / "sinal4_multiseno_malha_fechada.csv", place / "record.csv")
    return place


@pytest.fixture(scope="module", params=["msd", "msd_physical", "drone_arm"])
def trained(request: pytest.FixtureRequest, folder: Path) -> Trained:
    spec = folder / f"{request.param}.msnn.yaml"
    if not spec.exists():
        pytest.skip("the drone's records are not beside this checkout")
    model = load_model(spec)
    assert model.spec.data is not None
    data = load_data(model.program, model.spec.data, folder)
    result = train(model.program, data, model.spec.train, TrainingOptions(runs=None))
    closed = tuple(name for name in ("x",) if request.param == "msd")
    program = close_loop(
        prune_outputs(model.program, ["x_next" if "msd" in request.param else "q_next"]), closed
    )
    start, stop = max(data.stretches().tolist(), key=lambda s: s[1] - s[0])
    far = reach(program)
    # repeated forward and backward, so that there is no jump where one copy meets the next
    log = {
        name: np.concatenate([s[start:stop], s[start:stop][::-1]] * (1 + STEPS // (stop - start)))
        for name, s in data.series.items()
    }
    record = AgreementRecord(log, far.back, STEPS, request.param)
    return Trained(to_step_form(program), dict(result.weights), record)


@pytest.mark.parametrize(
    ("target", "dtype"),
    [
        ("torch", "float64"),
        ("casadi", "float64"),
        ("onnx", "float64"),
        ("c", "float64"),
        ("c", "float32"),
    ],
)
def test_target_agrees_along_the_record(
    trained: Trained, target: str, dtype: FloatType, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    plan = plan_of(target, trained.program, dtype)
    found = checked(plan, trained.weights, tmp_path, trained.record)
    assert found.steps == STEPS
    assert found.agrees, found
    if dtype == "float64":
        assert found.free_run <= FREE_RUN, found
    else:
        assert found.bits == 0
