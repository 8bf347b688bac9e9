"""What a robot learns of its bodies begins as the URDF says and stays what a body can have."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.ir.program import Program
from tests.features.robots.robots import URDF, model_of, outputs_at

TEXT = """
use: {{arm: {{robot: {{urdf: {0}/tree.urdf{1}}}}}}}
inputs: {{q: {{dims: arm.joint}}, dq: {{dims: arm.joint}}, u: {{dims: arm.joint}}}}
outputs: {{a: "arm.forward_dynamics(q, dq, u)", M: arm.mass_matrix(q)}}
"""


@pytest.fixture(scope="module")
def learning(tmp_path_factory: pytest.TempPathFactory) -> Program:
    text = TEXT.format(URDF, ", learn: [mass, com, inertia]")
    return model_of(tmp_path_factory.mktemp("robot"), text).program


def states(count: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    return {name: rng.uniform(-1.5, 1.5, (count, 5)) for name in ("q", "dq", "u")}


@pytest.mark.parametrize("what", ["mass", "com", "inertia", "mass, com, inertia"])
def test_it_begins_with_the_numbers_of_the_file(what: str, tmp_path: Path) -> None:
    known = outputs_at(model_of(tmp_path, TEXT.format(URDF, "")).program, states(5))
    learned = model_of(tmp_path, TEXT.format(URDF, f", learn: [{what}]")).program
    found = outputs_at(learned, states(5))
    for name, expected in known.items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-11, atol=1e-12, err_msg=name)


def test_bodies_have_the_names_of_their_links(learning: Program) -> None:
    labels = {d.name: d.labels for d in learning.dimensions}
    assert labels["arm.body"] == ("mast", "boom", "ram", "carriage", "gripper")
    assert {p.name: p.minimum for p in learning.parameters} == {
        "arm.mass": 0.0,
        "arm.com": None,
        "arm.size": 0.0,
        "arm.shear": None,
    }
    # the motor is fixed to the mast: one body
    assert learning.parameter("arm.mass").initial[0] == pytest.approx(6.2)


def test_whatever_is_learned_the_mass_matrix_is_positive_definite(learning: Program) -> None:
    @settings(deadline=None)
    @given(st.integers(0, 2**31))
    def is_positive_definite(seed: int) -> None:
        rng = np.random.default_rng(seed)
        weights = {
            "arm.mass": rng.lognormal(0, 1, 5),
            "arm.com": rng.normal(0, 0.3, (5, 3)),
            "arm.size": rng.lognormal(-2, 1, (5, 3)),
            "arm.shear": rng.normal(0, 0.2, (5, 3)),
        }
        M = outputs_at(learning, states(3), weights)["M"]
        np.testing.assert_allclose(M, M.transpose(0, 2, 1), rtol=1e-12)
        eigenvalues = np.linalg.eigvalsh(M)
        # what remains of rounding in a sum of numbers as large as the largest eigenvalue
        assert np.all(eigenvalues[:, 0] > -1e-12 * eigenvalues[:, -1])

    is_positive_definite()  # apart from the program, of whose length Hypothesis would warn instead


PLANAR = """
use: {{arm: {{robot: {{urdf: {0}/planar.urdf, joints: [{1}], learn: [{2}]}}}}}}
inputs: {{q: {{dims: arm.joint}}}}
outputs: {{g: arm.gravity_torque(q), M: arm.mass_matrix(q)}}
"""


def test_a_heavier_body_keeps_its_extent(tmp_path: Path) -> None:
    """Three times the mass of the lower link: three times its moments, about its centre too."""
    program = model_of(tmp_path, PLANAR.format(URDF, "shoulder, elbow", "mass")).program
    found = outputs_at(program, {"q": [[0.3, -0.8]]}, {"arm.mass": np.array([2.0, 3.0])})
    # of one link about the elbow: 1 kg with 0.02 kg m² about a centre 0.2 m away
    np.testing.assert_allclose(found["M"][0, 1, 1], 3 * (0.02 + 1 * 0.2**2), rtol=1e-13)


def test_a_centre_is_learned_along_the_axes_of_its_link(tmp_path: Path) -> None:
    """About -y, so that (x, y, z) of the link goes to x cos q - z sin q ahead of the shoulder."""
    program = model_of(tmp_path, PLANAR.format(URDF, "shoulder", "com")).program
    q = np.array([[0.3], [-1.1]])
    found = outputs_at(program, {"q": q}, {"arm.com": np.array([[0.2, 0.05, -0.4]])})
    torque = 3.0 * 9.81 * (0.2 * np.cos(q) + 0.4 * np.sin(q))
    np.testing.assert_allclose(found["g"], torque, rtol=1e-13)


def test_an_extent_is_learned_along_the_axes_of_its_link(tmp_path: Path) -> None:
    """Σ = m L Lᵀ, of which x and z turn about y; both links as one body of 3 kg."""
    program = model_of(tmp_path, PLANAR.format(URDF, "shoulder", "inertia, com")).program
    a, b, c, d, e, f = 0.3, 0.7, 0.2, 0.11, -0.23, 0.37
    weights = {
        "arm.com": np.array([[0.2, 0.05, -0.4]]),
        "arm.size": np.array([[a, b, c]]),
        "arm.shear": np.array([[d, e, f]]),
    }
    found = outputs_at(program, {"q": [[0.3]]}, weights)
    moment = 3.0 * (a**2 + e**2 + f**2 + c**2 + 0.2**2 + 0.4**2)
    np.testing.assert_allclose(found["M"], [[[moment]]], rtol=1e-13)
