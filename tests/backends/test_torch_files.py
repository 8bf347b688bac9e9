"""The standalone torch file agrees with the interpreter, without msnn, whatever the spec says."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch
from safetensors import safe_open

from backends.torch_module.module import build_module, physical_value
from backends.torch_module.source import write_torch
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends.readme_code import run_examples
from tests.backends.test_torch_module import agree
from tests.programs import SAMPLES


def imported(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def window(values: np.ndarray, t: np.ndarray, first: int, last: int) -> torch.Tensor:
    rows = t[:, None] + np.arange(first, last + 1)
    return torch.from_numpy(np.moveaxis(values[rows], 1, -1).copy())


def run(module: Any, program: Program, log: dict[str, np.ndarray], steps: int) -> None:
    judge = Interpreter(program)
    model = module.load()
    t = np.array([8, 15])
    states = judge.start(log, t)
    windows = {
        name: window(log[name], t, *extent) for name, extent in start_extents(program).items()
    }
    batch = {} if windows else {"batch": 2}
    for name, value in model.initial_state(windows, **batch).items():
        agree(value, states[name])
    for k in range(steps):
        inputs: dict[str, torch.Tensor] = {}
        for _, node in program.step:
            if isinstance(node.op, ReadSignal):
                found = window(log[node.op.signal], t + k, node.op.first, node.op.last)
                wide = node.type.window is not None
                inputs[node.op.signal] = found if wide else found[..., 0]
        state = {name: torch.from_numpy(np.array(value)) for name, value in states.items()}
        outputs, next_state = model(inputs, state)
        expected = judge.step(log, t + k, states)
        for name, value in outputs.items():
            agree(value, expected.outputs[name])
        for name, value in next_state.items():
            agree(value, expected.next_states[name])
        states = expected.next_states


def start_extents(program: Program) -> dict[str, tuple[int, int]]:
    from backends.ports.step_interface import step_interface

    return {p.signal.name: (p.first, p.last) for p in step_interface(program).start_windows}


@pytest.mark.parametrize("name", SAMPLES)
def test_agrees_with_the_interpreter(name: str, tmp_path: Path) -> None:
    sample = SAMPLES[name]()
    program = to_step_form(sample.program)
    write_torch(program, None, tmp_path, "plant")
    run(imported(tmp_path / "plant.py"), program, sample.log(60, 4), 20)


def test_the_readmes_run(tmp_path: Path) -> None:
    programs = {name: to_step_form(SAMPLES[name]().program) for name in SAMPLES}
    readmes = [
        write_torch(program, None, tmp_path / name, "plant", "float32")[2]
        for name, program in programs.items()
    ]
    for program, printed in zip(programs.values(), run_examples(readmes), strict=True):
        assert repr(program.outputs[0].name) in printed


@pytest.mark.parametrize(("dtype", "other"), [("float32", "float64"), ("float64", "float32")])
def test_module_and_readme_have_the_precision_that_was_asked_for(
    dtype: Literal["float32", "float64"], other: str, tmp_path: Path
) -> None:
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    write_torch(program, None, tmp_path, "plant", dtype)
    model = imported(tmp_path / "plant.py").load()
    assert {value.dtype for value in model.parameters()} == {getattr(torch, dtype)}
    readme = (tmp_path / "plant_torch.md").read_text(encoding="utf-8")
    assert f"dtype=torch.{dtype}" in readme
    assert other not in readme


@pytest.mark.parametrize("name", SAMPLES)
def test_the_code_computes_nothing_unused(name: str, tmp_path: Path) -> None:
    program = to_step_form(SAMPLES[name]().program)
    source, _, _ = write_torch(program, None, tmp_path, "plant", "float32")
    for part in source.read_text(encoding="utf-8").split("    def ")[1:]:
        if "batch = len(" in part:
            assert "expand(batch" in part
            assert "batch: int" not in part


def test_the_file_is_the_same_each_time(tmp_path: Path) -> None:
    program = to_step_form(SAMPLES["joint_arm"]().program)
    first = [path.read_bytes() for path in write_torch(program, None, tmp_path / "a", "arm")]
    second = [path.read_bytes() for path in write_torch(program, None, tmp_path / "b", "arm")]
    assert first == second


def test_names_and_descriptions_of_the_spec_stay_text(tmp_path: Path) -> None:
    sample = SAMPLES["spring_damper_rk4"]()
    hostile = '"""\nimport os; os.abort()\n\\" \u2028{{ 1/0 }} {% raise %} \x00'
    program = sample.program
    program = replace(
        program,
        name=hostile,
        doc=hostile,
        signals=tuple(replace(signal, doc=hostile) for signal in program.signals),
        parameters=tuple(replace(p, doc=hostile) for p in program.parameters),
        outputs=tuple(replace(output, name=hostile + output.name) for output in program.outputs),
    )
    program = to_step_form(program)
    write_torch(program, None, tmp_path, "plant")
    run(imported(tmp_path / "plant.py"), program, sample.log(40, 4), 3)


def test_bounds_hold_and_weights_are_physical(tmp_path: Path) -> None:
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    weights = {"mass": 3.5, "damping": 0.25, "stiffness": 40.0, "v_start": -0.5}
    write_torch(program, weights, tmp_path, "plant")
    model = imported(tmp_path / "plant.py").load()
    for name, value in weights.items():
        assert getattr(model, name).item() == value
    optimizer = torch.optim.SGD(model.parameters(), lr=1e3)
    (model.mass + model.damping).backward()
    optimizer.step()
    assert 0.1 <= model.mass.item() <= 10.0
    assert model.damping.item() >= 0.0


BOUNDS = [
    {"minimum": -1.0, "maximum": None},
    {"minimum": None, "maximum": 3.0},
    {"minimum": -1.0, "maximum": 3.0},
    {"minimum": 0.0, "maximum": None},
    {"minimum": None, "maximum": 0.0},
    {"minimum": -1e9, "maximum": 1e9},
]


@pytest.mark.parametrize("bounds", BOUNDS, ids=str)
def test_values_are_those_of_the_weights_to_the_bit_until_they_are_moved(
    bounds: dict[str, float | None], tmp_path: Path
) -> None:
    """log and exp of a bound's map round by parts of the bound: 0 came back as 1e-17."""
    low, high = bounds["minimum"], bounds["maximum"]
    drawn = np.random.default_rng(2).normal(0.0, 1.0, 20)
    ends = [value for value in (low, high) if value is not None]
    tried = np.clip([0.0, 1e-20, -1e-9, 0.1, *drawn, *ends], low, high).tolist()
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    changed = tuple(
        replace(p, initial=(tried[0],), minimum=low, maximum=high, scale=0.3)
        if p.name == "damping"
        else p
        for p in program.parameters
    )
    program = replace(program, parameters=changed)
    write_torch(program, None, tmp_path, "plant")
    model, inside = imported(tmp_path / "plant.py").load(), build_module(program)
    for value in tried:
        with torch.no_grad():
            model.damping = torch.tensor(value, dtype=torch.float64)
        inside.load_physical({"damping": np.array(value)})
        for damping, raw in (
            (model.damping, model.parametrizations.damping.original),
            (inside.physical()["damping"], inside.raw("damping")),
        ):
            assert damping.item() == value
            (slope,) = torch.autograd.grad(damping, raw)
            (mapped,) = torch.autograd.grad(physical_value(program.parameter("damping"), raw), raw)
            assert slope == mapped
        with torch.no_grad():
            model.parametrizations.damping.original.sub_(0.5)
            inside.raw("damping").sub_(0.5)
        # one that lies on a bound, or nearly, has a raw variable of its own that is off it
        if all(abs(value - end) > 1e-5 for end in ends):
            assert model.damping.item() < value
            assert inside.physical()["damping"].item() < value
    model = model.to(torch.float32)
    model.damping = torch.tensor(0.1).clip(low, high)
    assert model.damping.item() == np.float32(np.clip(0.1, low, high))


def test_a_parameter_that_is_pushed_to_a_bound_ends_on_it(tmp_path: Path) -> None:
    """The width of this range, rounded, reaches from its lower bound past the upper one."""
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    wide = tuple(
        replace(p, initial=(-1.0,), minimum=-1e9, maximum=1e-7) if p.name == "damping" else p
        for p in program.parameters
    )
    write_torch(replace(program, parameters=wide), None, tmp_path, "plant")
    model = imported(tmp_path / "plant.py").load()
    for raw, bound in ((1e9, 1e-7), (-1e9, -1e9)):
        with torch.no_grad():
            model.parametrizations.damping.original.fill_(raw)
        assert model.damping.item() == bound


@pytest.mark.parametrize("bounds", [{"minimum": 2.0}, {"maximum": 2.0}])
def test_what_rounding_put_beyond_a_bound_is_loaded_on_it(
    bounds: dict[str, float], tmp_path: Path
) -> None:
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    free: dict[str, float | None] = {"minimum": None, "maximum": None}
    held = tuple(
        replace(p, initial=(2.0,), **{**free, **bounds}) if p.name == "damping" else p
        for p in program.parameters
    )
    beyond = 2.0 - 1e-7 if "minimum" in bounds else 2.0 + 1e-7
    program = replace(program, parameters=held)
    write_torch(program, {"damping": beyond}, tmp_path, "plant")
    assert imported(tmp_path / "plant.py").load().damping.item() == 2.0


def test_numbers_that_are_not_learned_are_buffers_and_the_spec_is_named(
    tmp_path: Path,
) -> None:
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    program = replace(program, spec_hash="a" * 64)
    held = tuple(replace(p, learn=p.name != "damping") for p in program.parameters)
    write_torch(replace(program, parameters=held), None, tmp_path, "plant")
    model = imported(tmp_path / "plant.py").load()
    assert "damping" in dict(model.named_buffers())
    assert len(list(model.parameters())) == len(held) - 1
    assert model.damping.item() == program.parameter("damping").initial[0]
    with safe_open(tmp_path / "plant.safetensors", "np") as file:
        about = {"program": program.name, "spec_sha256": "a" * 64}
        assert file.metadata() == about


def test_needs_torch_and_safetensors_only(tmp_path: Path) -> None:
    write_torch(to_step_form(SAMPLES["fuzzy_local_models"]().program), None, tmp_path, "plant")
    script = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import plant; plant.load()\n"
        "ours = {'msnn', 'backends', 'compiler', 'spec_schema'} & set(sys.modules)\n"
        "assert not ours, ours\n"
    )
    subprocess.run([sys.executable, "-I", "-c", script], check=True, cwd=tmp_path)
