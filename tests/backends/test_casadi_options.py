"""What `params` and `form` of a CasADi export change, and what they leave as it is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import casadi
import numpy as np
import pytest

from backends.casadi_function.files import write_casadi
from backends.casadi_function.options import CasadiOptions
from compiler.passes.to_step_form import to_step_form
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from tests.agreement.exported import checked, plan_of
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.programs import SAMPLES

CHOICES = (("input", "mx"), ("inline", "sx"), ("inline", "mx"), ("input", "sx"))
PAIRS = [(name, *CHOICES[2 * (k % 2) + j]) for k, name in enumerate(NAMES) for j in range(2)]
"""Every model with each setting once, every pair of settings with each second model."""


@pytest.mark.parametrize(("name", "params", "form"), PAIRS)
def test_every_choice_agrees_with_the_judge(
    name: str, params: str, form: str, tmp_path: Path
) -> None:
    """Values and slopes, from states drawn over their ranges and beside singular ones."""
    program = to_step_form(load_model(spec_of(GALLERY, name)).program)
    plan = plan_of("casadi", program, "float64")
    plan = replace(plan, options=CasadiOptions(params=params, form=form))  # pyright: ignore[reportArgumentType]
    found = checked(plan, initial_weights(program), tmp_path)
    assert found.agrees, found
    assert found.jacobian is not None


@pytest.mark.parametrize("form", ["mx", "sx"])
def test_inline_parameters_are_no_inputs(form: str, tmp_path: Path) -> None:
    program = to_step_form(SAMPLES["joint_arm"]().program)
    weights = {"coupling": np.arange(9.0).reshape(3, 3)}
    options = CasadiOptions(params="inline", form=form)  # pyright: ignore[reportArgumentType]
    paths = write_casadi(program, weights, tmp_path / "inline", "arm", options)
    loaded = casadi.Function.load(str(paths[0]))
    assert loaded.is_a("SXFunction") == (form == "sx")
    assert loaded.n_instructions() > 9  # not one call of what is inside
    assert json.loads(paths[2].read_text(encoding="utf-8"))["parameters"] == []
    open_paths = write_casadi(program, weights, tmp_path / "open", "arm")
    known = json.loads(open_paths[2].read_text(encoding="utf-8"))["parameters"]
    given = {entry["port"]: entry["values"] for entry in known}
    whole = casadi.Function.load(str(open_paths[0]))
    assert [n for n in whole.name_in() if n not in given] == list(loaded.name_in())
    given |= {n: np.linspace(0.1, 0.9, loaded.size1_in(n)) for n in loaded.name_in()}
    named = whole(**{n: v for n, v in given.items() if n in whole.name_in()})
    for name, value in loaded(**{n: given[n] for n in loaded.name_in()}).items():
        np.testing.assert_array_equal(np.array(value), np.array(named[name]))


@pytest.mark.parametrize("form", ["mx", "sx"])
def test_a_zero_in_the_functions_hides_no_nan(form: str, tmp_path: Path) -> None:
    program = to_step_form(SAMPLES["joint_arm"]().program)
    options = CasadiOptions(params="inline", form=form)  # pyright: ignore[reportArgumentType]
    weights = {"coupling": np.zeros((3, 3))}
    step = casadi.Function.load(str(write_casadi(program, weights, tmp_path, "arm", options)[0]))
    values = step(*[np.full(step.size1_in(i), np.nan) for i in range(step.n_in())])
    assert np.isnan(np.array(values[0])).all()
