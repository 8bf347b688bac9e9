"""The C of whole examples as it was read: fuzzy sets, histories, an integrator, fixed point."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import msnn
from tests.examples.gallery import GALLERY, spec_of
from tests.features.fixed_point.exported import fixed_model, gallery_text
from tests.golden import assert_golden, without_identity

GOLDEN = Path(__file__).parents[1] / "golden"

WHOLE = {
    # 25 taps, fuzzy sets, a local model, a kernel, one state: everything but the golden vectors
    "reference": ("include/{}.h", "src/{}.c", "src/{}_params.c", "src/{}_math.c", "{}.json"),
    # a state space, histories, clamped and held inputs, midpoint in two substeps
    "heater": ("src/{}.c",),
    # a grid of fuzzy sets of which only the active ones are evaluated, previews, a closed loop
    "lane_keeper": ("src/{}.c",),
}


@pytest.mark.parametrize("name", WHOLE)
def test_the_c_of_an_example_is_as_it_was_read(name: str, accept: bool, tmp_path: Path) -> None:
    msnn.export(msnn.load(spec_of(GALLERY, name)), "c", tmp_path)
    _assert_as_read(tmp_path, name, f"c_gallery_{name}", WHOLE[name], accept)


def test_the_c_of_an_example_in_fixed_point_is_as_it_was_read(accept: bool, tmp_path: Path) -> None:
    model = fixed_model(tmp_path, gallery_text("reference"), "q15")
    msnn.export(model, "c", tmp_path)
    _assert_as_read(tmp_path, "reference", "c_gallery_reference_q15", ("src/{}.c",), accept)


def _assert_as_read(
    folder: Path, name: str, golden: str, files: tuple[str, ...], accept: bool
) -> None:
    (made,) = (path.parent for path in folder.rglob("src") if (path / f"{name}.c").is_file())
    for file in files:
        path = made / file.format(name)
        # another version of msnn, or a comment in the spec, is no change of code
        text = re.sub(r'("msnn )[\d.]+\w*"', r'\1…"', path.read_text(encoding="utf-8"))
        assert_golden(GOLDEN / golden / path.name, without_identity(text), accept)
