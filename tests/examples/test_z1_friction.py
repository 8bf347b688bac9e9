"""The arm's example: its specs are silent, and its friction is exported as C without the robot."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from backends.native import sensitivity_kernel
from backends.native.sensitivity_kernel import SensitivityKernel, StackTooSmallError
from compiler.differentiation.sensitivities import Sensitivities, sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from compiler.interpreter.interpreter import Interpreter
from msnn.cli.application import run
from msnn.data.rollout_rows import Runs
from msnn.model.load import load_model
from msnn.simulation.engines.kernel_check import check_sensitivities
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.native.test_kernel import initial

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "z1_friction"


@pytest.mark.parametrize("name", ["z1_friction", "bodies"])
def test_units_fit(name: str) -> None:
    assert load_model(EXAMPLE / f"{name}.msnn.yaml", strict_units=True).warnings == ()


def test_the_tables_of_the_page_are_those_of_the_results(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLE))
    monkeypatch.delitem(sys.modules, "results", raising=False)
    found = json.loads((EXAMPLE / "results.json").read_text(encoding="utf-8"))
    tables = importlib.import_module("results").tables(found)
    monkeypatch.delitem(sys.modules, "results")  # other examples have one too
    assert f"\n\n{tables}\n\n" in (EXAMPLE / "README.md").read_text(encoding="utf-8")
    for figure in (EXAMPLE / "figures").iterdir():
        assert figure.stat().st_size < (100_000 if figure.suffix == ".png" else 150_000)


@pytest.mark.parametrize("kind", ["LSTM", "MLP"])
def test_networks_learn_joints_that_know_no_friction_model(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The black boxes of the comparison, on a few short rollouts of six driven joints."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    for name in ("results", "truth", "evaluate", "networks"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    networks, evaluate = map(importlib.import_module, ("networks", "evaluate"))
    for name in ("results", "truth", "evaluate", "networks"):  # other examples have some too
        monkeypatch.delitem(sys.modules, name)
    random, time = np.random.default_rng(0), evaluate.SAMPLE_TIME * np.arange(201)

    def episode() -> dict[str, np.ndarray]:
        tau = 10 * np.sin(np.outer(time, random.uniform(2, 6, 6)) + random.uniform(0, 6, 6))
        q, dq = np.zeros((2, 201, 6))
        for t in range(200):
            dq[t + 1] = dq[t] + evaluate.SAMPLE_TIME * (tau[t] - 2 * dq[t])
            q[t + 1] = q[t] + evaluate.SAMPLE_TIME * (dq[t] + dq[t + 1]) / 2
        return {"tau": tau, "q": q, "dq": dq}

    monkeypatch.setattr(networks, "UPDATES", {"accelerations": 40, "rollouts": 10})
    network = networks.Network(kind, [episode() for _ in range(4)], [episode()])
    given = evaluate.windows([episode()])
    found = network.simulated(given)
    assert found.shape == given.q.shape
    coasting = given.q0 + evaluate.SAMPLE_TIME * np.arange(1, 51)[:, None, None] * given.dq0
    # 0.76 and 0.79 of it; untrained 1.06 and 1.19
    assert np.mean((found - given.q) ** 2) < 0.9 * np.mean((coasting - given.q) ** 2)


def test_the_kept_errors_are_those_that_were_asked_for() -> None:
    found = json.loads((EXAMPLE / "results.json").read_text(encoding="utf-8"))
    error = {name: np.mean(each) for name, each in found["errors"].items()}
    assert error["learned"] <= error["least squares"] / 30
    assert error["learned"] <= 1.5 * error["true"]
    for states in ("exact", "noisy"):
        errors = {name: each[states] for name, each in found["tracking"].items()}
        assert errors["true"] < errors["learned"] < errors["none"] / 30


def test_the_baselines_move_by_the_integrator_of_the_spec(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the page compares are frictions: bodies and integrator are the same for all."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    names = ("evaluate", "results", "truth")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    evaluate = importlib.import_module("evaluate")
    for name in names:
        monkeypatch.delitem(sys.modules, name)
    rng = np.random.default_rng(4)
    weights = {f"C_{name}": rng.normal(size=(6, 3)) for name in "vcsw"} | {"w_0": np.array(0.06)}
    save_file(weights, tmp_path / "weights.safetensors")
    log = {name: rng.uniform(-1, 1, (21, 6)) for name in ("tau", "q", "dq")}
    interpreter = Interpreter(load_model(EXAMPLE / "z1_friction.msnn.yaml").program, weights)
    rows = np.arange(20)  # the losses read a sample ahead
    expected = interpreter.step(log, rows, interpreter.start(log, rows)).outputs
    log = {name: series[rows] for name, series in log.items()}
    given = evaluate.Windows(log["q"], log["dq"], log["tau"][None], log["q"][None], log["dq"][None])
    friction = evaluate.learned(tmp_path / "weights.safetensors")
    (found,) = evaluate.simulated(evaluate.Bodies(), friction, given)
    # the slopes of friction are differences over 2e-6 there, of rounding 1e-16 / 1e-6 beside 1
    np.testing.assert_allclose(found, expected["q_next"], rtol=0, atol=1e-9)


def _sensitivities() -> Sensitivities:
    model = load_model(EXAMPLE / "z1_friction.msnn.yaml")
    plan = plan_stages(model.program, model.spec.train, Findings())[-1]
    return sensitivities(with_compared_squares(plan.rollout.program), plan.trained)


def test_slopes_that_overflow_a_usual_stack_get_one_of_their_own() -> None:
    """Those of a step of the arm in all 73 numbers took 8.1 MiB, and the process ended."""
    require_tool("gcc", install="apt-get install gcc")
    found = _sensitivities()
    kernel = SensitivityKernel(found)
    rng = np.random.default_rng(1)
    log = {name: rng.uniform(-1, 1, (12, 6)) for name in ("tau", "q", "dq")}
    weights = initial(found.program)
    runs = Runs(np.arange(2), np.full(2, 3), 0, 12)
    check_sensitivities(kernel, found, log, runs, weights)


def test_slopes_that_overflow_every_stack_have_no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensitivity_kernel, "LARGEST_STACK", 4 * 2**20)
    with pytest.raises(StackTooSmallError, match=r"a step needs 5\.\d MiB of stack"):
        SensitivityKernel(_sensitivities())


def test_the_friction_compensator_is_c_without_the_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt-get install gcc")
    for file in [*EXAMPLE.glob("*.yaml"), *EXAMPLE.glob("*.urdf")]:
        shutil.copy(file, tmp_path)
    # of an arm that nobody has trained yet
    spec = tmp_path / "compensator.msnn.yaml"
    text = spec.read_text(encoding="utf-8")
    weights = "weights: runs/z1_friction/latest/weights.safetensors, "
    assert weights in text
    spec.write_text(text.replace(weights, ""), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    code = run(["export", str(spec), "--to", "c", "--check", "--format", "json"])
    said = json.loads(capsys.readouterr().out)
    assert code == 0, said
    (file,) = (tmp_path / "build").rglob("z1_friction.c")
    step = file.read_text(encoding="utf-8")
    assert "tau_f" in step
    assert "ddq" not in step
