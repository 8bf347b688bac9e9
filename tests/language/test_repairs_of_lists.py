"""Whoever follows the help of a list that is refused has a spec that compiles."""

from __future__ import annotations

import numpy as np

from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.language.compiled import compiled, evaluated

JOINTS = """
dims: {joint: 3, side: 2}
inputs: {u: {dims: joint}, v: {dims: joint}}
outputs: {y: "[2 * u, v]"}
"""


def refused(text: str) -> Diagnostic:
    try:
        compiled(text)
    except SpecError as error:
        return error.diagnostics[0]
    raise AssertionError("this compiles")


def test_a_list_of_vectors_is_a_stack() -> None:
    found = refused(JOINTS)
    assert found.code == "E0402"
    assert "`stack(2 * u, v, dim=NAME)`" in (found.help or "")
    text = JOINTS.replace("[2 * u, v]", "stack(2 * u, v, dim=side)")
    log = {"u": np.array([[1.0, 2.0, 3.0]]), "v": np.array([[4.0, 5.0, 6.0]])}
    y = evaluated(text, log)
    assert sorted(y.ravel()) == [2.0, 4.0, 4.0, 5.0, 6.0, 6.0]


SQUARE = """
dims: {n: 3}
inputs: {x: {dims: n}}
parameters: {A: {dims: [n, n], init: 2}}
outputs: {y: "A @ x"}
"""


def test_a_square_matrix_has_a_second_dim_of_its_size() -> None:
    found = refused(SQUARE)
    assert found.code == "E0225"
    assert "`dims: {n2: …}`" in (found.help or "")
    assert "`[n2, n]`" in (found.help or "")
    text = SQUARE.replace("{n: 3}", "{n: 3, n2: 3}").replace("[n, n]", "[n2, n]")
    y = evaluated(text, {"x": np.array([[1.0, 2.0, 3.0]])})
    assert y.tolist() == [12.0, 12.0, 12.0]
