"""Every reference case in every backend; `reference_case.py` says how one is written."""

from typing import get_args

import pytest

from msnn.exports.table import TARGETS
from msnn.simulation.engines.engine import EngineName
from spec_schema.sections.layers import Layer
from tests.conditions import require_tool
from tests.language.reference_case import (
    BACKENDS,
    CASES,
    ENGINES,
    EXPORTS,
    assert_case,
    read_case,
)

NAMES = sorted(str(path.relative_to(CASES).with_suffix("")) for path in CASES.glob("*/*.yaml"))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NAMES)
def test_reference_case(name: str, backend: str) -> None:
    require_tool("gcc", install="apt install gcc")
    assert_case(read_case(CASES / f"{name}.yaml"), backend)


@pytest.mark.parametrize("kind", Layer.known_keys())
def test_every_layer_has_a_reference_case(kind: str) -> None:
    assert any((CASES / kind).glob("*.yaml")), f"write a case in tests/language/cases/{kind}/"


def test_every_engine_runs_the_cases() -> None:
    missing = {*get_args(EngineName)} - {name for name, runs in ENGINES.items() if runs}
    assert not missing, f"give {missing} a run in ENGINES of tests/language/reference_case.py"


def test_every_target_runs_the_cases() -> None:
    """A unit of FMI holds the C that runs here; controllers and filters have no samples."""
    stepped = {target.name for target in TARGETS if not target.sections} - {"fmu"}
    missing = stepped - {target for target, _ in EXPORTS.values()}
    assert not missing, f"give {missing} a row of EXPORTS in tests/language/reference_case.py"


def test_c_runs_in_both_sizes_of_numbers() -> None:
    """In float32 the bits of the judge are compared too, which no other backend shows."""
    assert {dtype for target, dtype in EXPORTS.values() if target == "c"} == {"float32", "float64"}
    assert "c32" in BACKENDS
