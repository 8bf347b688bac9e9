"""Every reference case in every backend; `reference_case.py` says how one is written."""

import pytest

from spec_schema.sections.layers.layer import Layer
from tests.conditions import require_tool
from tests.language.reference_case import BACKENDS, CASES, assert_case, read_case

NAMES = sorted(str(path.relative_to(CASES).with_suffix("")) for path in CASES.glob("*/*.yaml"))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NAMES)
def test_reference_case(name: str, backend: str) -> None:
    require_tool("gcc", install="apt install gcc")
    assert_case(read_case(CASES / f"{name}.yaml"), backend)


@pytest.mark.parametrize("kind", Layer.known_keys())
def test_every_layer_has_a_reference_case(kind: str) -> None:
    assert any((CASES / kind).glob("*.yaml")), f"write a case in tests/language/cases/{kind}/"
