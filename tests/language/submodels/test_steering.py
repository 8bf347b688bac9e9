"""R11: a steering controller that is trained through a frozen vehicle model, and deployed alone."""

from pathlib import Path

import numpy as np

from compiler.passes.close_loop import close_loop
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.project.workflow_checks import checked_model
from tests.language.submodels.submodels import names, run
from tests.language.targets.every_backend import assert_backends_agree_on

SPEC = Path(__file__).parents[1] / "drafts" / "lateral.msnn.yaml"


def test_the_steering_specs_have_nothing_wrong_with_them() -> None:
    model = checked_model(SPEC)
    assert model.warnings == ()
    found = names(model.program)
    # the vehicle's logged curvature is a target that nothing here reads
    assert found["signals"] == ["v", "a", "rho", "delta"]
    assert found["parameters"] == ["W", "w0"]
    assert found["states"] == ["steer.history", "integral.state", "integral.state2"]
    assert found["outputs"] == ["steer", "vehicle.rho_hat"]
    assert found["dims"] == ["preview", "past", "v_ch", "a_ch", "vehicle.past"]


def test_the_vehicle_is_steered_by_the_log_and_then_by_the_controller() -> None:
    random = np.random.default_rng(2)
    log = {
        "v": random.uniform(8, 23, size=100),
        "a": random.uniform(-2, 2, size=100),
        "rho": random.normal(scale=0.01, size=100),
        "delta": random.normal(scale=0.1, size=100),
    }
    program = close_loop(checked_model(SPEC).program, ["delta"])
    t0, steps = 40, 6
    steer = run(program, log, t0, steps, output="steer")
    found = run(program, log, t0, steps, output="vehicle.rho_hat")
    steered = np.concatenate([log["delta"][:t0], steer])
    taper = np.exp(-((np.arange(-29, 1) / 15) ** 2))
    for step in range(steps):
        t = t0 + step
        # all weights W are 1 and all A are 1e-5, and memberships sum to 1
        expected = taper @ steered[t - 29 : t + 1] / (1 + 1e-5 * log["v"][t] ** 2)
        np.testing.assert_allclose(found[step], expected, rtol=1e-12)


def test_the_controller_is_deployed_without_the_vehicle() -> None:
    """docs/language.md, Export (R13)."""
    program = close_loop(checked_model(SPEC).program, ["delta"])
    step = to_step_form(prune_outputs(program, ["steer"]))
    assert names(step)["outputs"] == ["steer"]
    assert "steer.history" not in names(step)["states"]
    # 8 x 30 weights of the controller; those of the vehicle were as many numbers of the program
    assert not [node for _, node in step.step if node.label == "vehicle.W"]
    assert [node for _, node in checked_model(SPEC).program.step if node.label == "vehicle.W"]


def test_every_backend_computes_the_controller_and_the_vehicle() -> None:
    random = np.random.default_rng(4)
    log = {name: random.uniform(0.1, 2.0, size=80) for name in ("v", "a", "rho", "delta")}
    program = checked_model(SPEC).program
    # the integrals of a loss read the log, and are not computed by an export
    exported = prune_outputs(program, ["steer", "vehicle.rho_hat"])
    assert_backends_agree_on(exported, log, [35, 40])
