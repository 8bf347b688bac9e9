"""What a robot learns of its bodies begins as the URDF says and stays what a body can have."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.ir.program import Program
from tests.robots.robots import URDF, model_of, outputs_at

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
