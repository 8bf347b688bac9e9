"""The generated blocks of `docs/` say what the code says now; `--accept` writes them anew."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pytest

from compiler.elaboration.compile import compile_spec
from compiler.ir.ops import Op
from spec_schema.reading.reader import read_spec
from tests.docs.action import action_inputs, sample_hooks, sample_workflow
from tests.docs.commands import exit_codes, verbs
from tests.docs.decisions import PAGES as DECISIONS
from tests.docs.decisions import decisions
from tests.docs.diagnostics import diagnostics
from tests.docs.front_page import PICTURE, front_c, front_figures, front_picture, front_spec
from tests.docs.keys import keys
from tests.docs.layers import layers
from tests.docs.markdown import block_names, with_blocks
from tests.docs.names import names
from tests.docs.operations import (
    LOWERINGS,
    builtins,
    core_operations,
    lowered_by,
    scalar_functions,
)
from tests.docs.plugins import plugin_builder, plugin_context, plugin_functions
from tests.docs.targets import targets
from tests.golden import assert_golden

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))

BLOCKS: dict[str, Callable[[], str]] = {
    "builtins": builtins,
    "core operations": core_operations,
    "decisions": decisions,
    "diagnostics": diagnostics,
    "exit codes": exit_codes,
    "keys": keys,
    "front c": front_c,
    "front figures": front_figures,
    "front spec": front_spec,
    "inputs of the action": action_inputs,
    "functions for authors": plugin_functions,
    "layers": layers,
    "names": names,
    "methods of the builder": plugin_builder,
    "methods of the context": plugin_context,
    "sample hooks": sample_hooks,
    "sample workflow": sample_workflow,
    "scalar functions": scalar_functions,
    "targets": targets,
    "verbs": verbs,
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_generated_blocks_are_up_to_date(page: Path, accept: bool):
    text = page.read_text(encoding="utf-8")
    assert_golden(page, with_blocks(text, BLOCKS), accept)


def test_the_picture_of_the_front_page_is_what_show_draws(accept: bool):
    assert_golden(PICTURE, f"{front_picture()}\n", accept)


def test_every_block_has_its_page():
    shown = [name for page in PAGES for name in block_names(page.read_text(encoding="utf-8"))]
    assert sorted(shown) == sorted(BLOCKS)


@pytest.mark.parametrize(
    "page",
    [
        *PAGES,
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "msnn" / "features").glob("*/README.md")),
        *DECISIONS,
    ],
    ids=lambda page: f"{page.parent.name}/{page.name}",
)
def test_links_lead_somewhere(page: Path):
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_spec_in_language_md_compiles_without_a_word():
    text = (ROOT / "docs" / "language.md").read_text(encoding="utf-8")
    (spec,) = re.findall(r"```yaml\n(msnn: 1.*?)```", text, re.DOTALL)
    read = read_spec(Path("language.yaml"), spec)
    assert (*read.warnings, *compile_spec(read.spec).warnings) == ()


@pytest.mark.parametrize("column", LOWERINGS)
def test_every_backend_has_a_case_for_every_operation(column: str):
    forgotten = {op.__name__ for op in get_args(Op)} - lowered_by(LOWERINGS[column])
    assert not forgotten, f"{LOWERINGS[column]} has no case for {', '.join(sorted(forgotten))}"
