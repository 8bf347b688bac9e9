"""Steppers: the numbers of the exported C to the bit, in the interpreter too; names, states."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from backends.c.host.build import build_library
from backends.c.host.library import CStep
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.stepping import Stepper
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.examples.gallery import NAMES, gallery_copy, spec_of

CART = """
msnn: 1
name: cart
sample_time: 0.1 s
inputs:
  F: {unit: N, range: [-5, 5], on_invalid: clamp}
  wind: {unit: N}
parameters: {mass: {init: 2, unit: kg}}
states:
  x: {unit: m, der: v, init: 0.5}
  v: {unit: m/s, der: (F + wind) / mass, init: 0}
outputs: {x_next: next(x)}
"""
WINDOWS = """
msnn: 1
name: windows
sample_time: 0.1 s
dims: {wheel: 2}
inputs: {u: {dims: wheel}, x: {}}
layers: {h: {fir: {window: 3}}, g: {fir: {window: 4}}}
outputs: {y: h(u), x_next: {expr: "g(x) + 0.1*sum(u)", predicts: "x[t+1]"}}
export: {c: {dtype: float64, close: [x]}}
"""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


def model_of(text: str, folder: Path) -> Model:
    path = folder / "model.msnn.yaml"
    path.write_text(text)
    return load_model(path)


def exported(model: Model, folder: Path) -> CStep:
    """The C as users build it."""
    msnn.export(model, "c", folder / "c")
    return CStep.of_folder(folder / "c", build_library(folder / "c", folder / "c.so"))


def without_compiler(model: Model, monkeypatch: pytest.MonkeyPatch) -> Stepper:
    with monkeypatch.context() as patched:
        patched.setenv("CC", "no-such-compiler")
        with pytest.warns(RuntimeWarning, match="W1003"):
            return msnn.stepper(model)


def drawn(shapes: Mapping[str, tuple[int, ...]], steps: int) -> Iterator[dict[str, Any]]:
    random = np.random.default_rng(1)
    for _ in range(steps):
        yield {name: random.uniform(-1, 1, shape) for name, shape in shapes.items()}


def same(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        np.testing.assert_array_equal(ours[name], value, err_msg=name)


@pytest.mark.parametrize("name", NAMES)
def test_the_numbers_are_those_of_the_exported_c(
    name: str, gallery: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled as users compile it, and stepped by the interpreter, from a reset and from init."""
    model = load_model(spec_of(gallery, name))
    deployed = exported(model, tmp_path)
    steppers = msnn.stepper(model), without_compiler(model, monkeypatch)
    assert [stepper.engine for stepper in steppers] == ["c", "interpreter"]
    starts = next(drawn(deployed.start_shapes, 1))
    deployed.reset(starts)
    for stepper in steppers:
        stepper.reset(**starts)
    for inputs in drawn(deployed.input_shapes, 40):
        outputs, status = deployed.step(inputs)
        for stepper in steppers:
            same(stepper.step(**inputs), outputs)
            same(stepper.state, deployed.states())
            assert sum(deployed.status_bits[bit] for bit in macros(deployed, stepper)) == status


def macros(deployed: CStep, stepper: Stepper) -> list[str]:
    """The names in the header of what a stepper's status says."""
    ends = {f"_STATUS_{bit}" for bit in stepper.status}
    return [name for name in deployed.status_bits if any(name.endswith(end) for end in ends)]


@pytest.mark.parametrize("text", [CART, WINDOWS])
def test_init_and_invalid_inputs_are_those_of_the_exported_c(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Buffers that the first step fills, values that are clamped, states that are written."""
    model = model_of(text, tmp_path)
    deployed = exported(model, tmp_path)
    for stepper in (msnn.stepper(model), without_compiler(model, monkeypatch)):
        if "x" in deployed.start_shapes:  # its first samples are the model's own
            deployed.reset({name: np.ones(s) for name, s in deployed.start_shapes.items()})
            stepper.reset(**{name: np.ones(s) for name, s in deployed.start_shapes.items()})
        else:
            deployed.init()
            stepper.reset()
        for inputs in drawn(deployed.input_shapes, 20):
            inputs = {n: value * 20 if n == "F" else value for n, value in inputs.items()}
            same(stepper.step(**inputs), deployed.step(inputs)[0])
        kept = stepper.state
        after = [stepper.step(**inputs) for inputs in drawn(deployed.input_shapes, 5)]
        stepper.state = kept
        again = [stepper.step(**inputs) for inputs in drawn(deployed.input_shapes, 5)]
        for first, second in zip(after, again, strict=True):
            same(first, second)


def test_instances_are_independent_and_weights_come_in_every_form(tmp_path: Path) -> None:
    model = model_of(CART, tmp_path)
    light, heavy = msnn.stepper(model, {"mass": 1.0}), msnn.stepper(model, {"mass": 4.0})
    plain = msnn.stepper(model)
    for stepper in (light, heavy, plain):
        stepper.step(F=1.0, wind=0.0)
    assert light.state["v"] == pytest.approx(0.1)
    assert heavy.state["v"] == pytest.approx(0.025)
    assert plain.state["v"] == pytest.approx(0.05)


def test_reset_takes_states_and_begins_anew_without(tmp_path: Path) -> None:
    stepper = msnn.stepper(model_of(CART, tmp_path))
    stepper.step(F=1, wind=np.float32(2))
    stepper.reset(v=3)
    assert stepper.state == {"x": 0.5, "v": 3.0}
    stepper.reset()
    assert stepper.state == {"x": 0.5, "v": 0.0}
    stepper.state = {"x": 1.0}
    assert stepper.state == {"x": 1.0, "v": 0.0}


def test_one_sample_stands_for_a_window(tmp_path: Path) -> None:
    stepper = msnn.stepper(model_of(WINDOWS, tmp_path))
    with pytest.raises(ValueError, match=r"`reset` wants .*`x` \(4 samples, t-3 … t\)"):
        stepper.step(u=[1.0, 2.0])
    with pytest.raises(ValueError, match="`reset` wants"):
        stepper.reset()
    no_numbers: list[Any] = ["fast", object(), [1.0, None, "fast", 2.0]]
    for wrong in no_numbers:
        with pytest.raises(ValueError, match="`x` is not made of numbers: "):
            stepper.reset(x=wrong, u=[1.0, 3.0])
    stepper.reset(x=2.0, u=[1.0, 3.0])
    np.testing.assert_array_equal(stepper.state["x.tape"], [2.0] * 4)


def test_mistakes_are_named_and_change_nothing(tmp_path: Path) -> None:
    stepper = msnn.stepper(model_of(CART, tmp_path))
    stepper.step(F=1.0, wind=0.0)
    before = stepper.state
    cases: list[tuple[dict[str, Any], str]] = [
        ({"F": 1.0}, "`step` takes `F`, `wind`; `wind` is missing"),
        ({"F": 1.0, "wind": 0.0, "w": 1}, "`w` is unknown"),
        ({"f": 1.0, "wind": 0.0}, "did you mean `F`?"),
        ({"F": [1.0, 2.0], "wind": 0.0}, "`F` is a number"),
        ({"F": "much", "wind": 0.0}, "`F` is a number, not 'much'"),
        ({"F": 0.0, "wind": np.nan}, "`wind` is nan: `on_invalid: clamp`"),
        ({"F": 0.0, "wind": -np.inf}, "`wind` is -inf"),
    ]
    for inputs, message in cases:
        with pytest.raises(ValueError, match=re.escape(message)):
            stepper.step(**inputs)
    starts: list[tuple[dict[str, Any], str]] = [
        ({"y": 1.0}, "unknown"),
        ({"v": [1.0]}, "shape"),
        ({"v": object()}, "`v` is not made of numbers: <object"),
        ({"v": "fast"}, "`v` is not made of numbers: 'fast'"),
        ({"v": np.nan}, "`v` is nan: no step brings a state back"),
        ({"v": -np.inf}, "`v` is -inf"),
    ]
    for wrong, message in starts:
        with pytest.raises(ValueError, match=message):
            stepper.reset(**wrong)
        with pytest.raises(ValueError, match=message):
            stepper.state = wrong
    assert stepper.state == before


def test_what_a_policy_replaces_is_no_error(tmp_path: Path) -> None:
    stepper = msnn.stepper(model_of(CART, tmp_path))
    stepper.step(F=np.nan, wind=0.0)
    assert stepper.status == ("NOT_A_NUMBER", "CLAMPED")
    assert stepper.state["v"] == 0.0
    stepper.step(F=1.0, wind=0.0)
    assert stepper.status == ()
    stepper.step(F=1.0, wind=1e300)  # finite, and too large for the C's numbers
    assert "OUT_OF_RANGE" in stepper.status


def test_fixed_point_is_refused(tmp_path: Path) -> None:
    text = CART.replace("wind: {unit: N}", "wind: {unit: N, range: [-1, 1]}")
    text += "export: {c: {dtype: q15}}\n"
    with pytest.raises(SpecError, match="E1044"):
        msnn.stepper(model_of(text.replace("init: 0.5}", "range: [-9, 9]}"), tmp_path))


def test_with_a_compiler_nothing_is_said(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        msnn.stepper(model_of(CART, tmp_path))
