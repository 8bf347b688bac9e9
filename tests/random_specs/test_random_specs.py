"""Some random specs through everything; `benchmarks/fuzz/specs.py` takes as many as are wanted."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from compiler.ir.program import Graph, Parameter, Program
from msnn.data.dataset import FloatArray
from msnn.exports.table import NAMES
from msnn.model.weights.weights_file import initial_weights
from tests.random_specs.drawn_weights import drawn_weights
from tests.random_specs.generate import random_spec
from tests.random_specs.random_spec import RandomSpec
from tests.random_specs.shrink import shrunk
from tests.random_specs.trial import Fault, fault_of

CASES = Path(__file__).parent / "cases"

EVERYWHERE = (3, 8)
"""Seeds of specs that train: with a compiler each takes a second or two. The weights of 8 are
initial ones, those of 3 drawn."""


@pytest.mark.parametrize("first", range(0, 24, 8))
def test_random_specs_are_checked_and_shown(first: int) -> None:
    for seed in range(first, first + 8):
        fault = fault_of(random_spec(seed), targets=(), kernel=False)
        assert fault is None, f"seed {seed}: {fault.stage}: {fault.detail}"


@pytest.mark.parametrize("seed", EVERYWHERE)
def test_random_specs_mean_the_same_everywhere(seed: int) -> None:
    compared = Counter[str]()
    weights_of = partial(drawn_weights, seed=seed)
    fault = fault_of(random_spec(seed), weights_of=weights_of, compared=compared)
    assert fault is None, f"{fault.stage}: {fault.detail}"
    # no spec asks for a controller
    assert compared == dict.fromkeys({*NAMES, "kernel"} - {"mpc"}, 1)


@dataclass(frozen=True)
class _Kept:
    folder: Path

    def texts(self) -> dict[str, str]:
        return {file.name: file.read_text() for file in self.folder.glob("*.yaml")}

    def weights(self, program: Program) -> dict[str, FloatArray]:
        """Those of its file; the initial ones without one."""
        file = self.folder / "weights.json"
        kept = json.loads(file.read_text()) if file.exists() else {}
        return initial_weights(program) | {name: np.array(kept[name]) for name in kept}


@pytest.mark.parametrize("case", sorted(CASES.iterdir()), ids=lambda folder: folder.name)
def test_what_random_specs_have_found(case: Path) -> None:
    """Findings that are mended, as small as they became."""
    kept = _Kept(case)
    fault = fault_of(kept, weights_of=kept.weights)
    assert fault is None, f"{fault.stage}: {fault.detail}"


def test_drawn_weights_are_large_tiny_zero_and_at_bounds() -> None:
    """Each kind is there among few seeds, with weights that a weights file may hold."""
    parameters = tuple(Parameter(f"p{k}", initial=(0.5,)) for k in range(6))
    parameters = (*parameters, Parameter("bounded", initial=(0.5,), minimum=-0.25))
    program = Program("p", 0.1, (), parameters, (), Graph(()), Graph(()), ())
    drawn = [drawn_weights(program, seed) for seed in range(1, 64)]
    sizes = np.abs([float(each[name]) for each in drawn for name in each])
    assert sizes.max() > 1e38
    assert np.any((sizes > 10) & (sizes < 1e5))
    assert np.any((sizes > 0) & (sizes < 1e-29))
    assert np.any(sizes == 0)
    assert np.any(sizes == 0.25)
    assert drawn_weights(program, 64) == initial_weights(program)


REFUSED = """
msnn: 1
name: refused
inputs: {u: {}}
targets: {z: {}}
parameters: {k: 1}
outputs: {y: {expr: k * u, predicts: z}}
train: [{epochs: 1, engine: torch, reproducible: true}]
"""


def test_a_stage_that_is_refused_is_a_fault(tmp_path: Path) -> None:
    """A training that was not tried has not gone well."""
    (tmp_path / "spec.msnn.yaml").write_text(REFUSED)
    fault = fault_of(_Kept(tmp_path), targets=())
    assert fault is not None
    assert (fault.stage, fault.kind) == ("train", "refused: E0988")


def test_a_seed_is_the_same_spec_everywhere() -> None:
    assert random_spec(7).texts() == random_spec(7).texts()
    assert random_spec(7).texts() != random_spec(8).texts()


def test_a_fault_is_shown_by_a_small_spec() -> None:
    """As if every call of a function were wrong."""
    wrong = Fault("show", "tanh", "")

    def fault_of_tanh(spec: RandomSpec) -> Fault | None:
        return wrong if "tanh(" in str(spec.sections.get("outputs")) else None

    seed = next(s for s in range(100) if fault_of_tanh(random_spec(s)) is not None)
    small = shrunk(random_spec(seed), wrong, fault_of_tanh, 30.0)
    assert list(small.sections) == ["msnn", "name", "outputs"]
    assert len(small.sections["outputs"]) == 1
    assert small.size < 120
