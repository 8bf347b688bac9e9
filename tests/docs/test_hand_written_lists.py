"""Lists that people write name everything that the code has; what fails says where to add it."""

from __future__ import annotations

import re
from pathlib import Path

from compiler.kernels.table import KERNELS
from compiler.layers import LAYERS, rule_of
from spec_schema.fields.entry_kinds import kinds_of
from spec_schema.sections.layers.layer import Layer
from spec_schema.sections.training.optimizers import Optimizer

DOCS = Path(__file__).parents[2] / "docs"


def _page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def test_every_layer_has_its_rule() -> None:
    declared = {kinds_of(Layer.model_fields[kind].annotation)[0] for kind in Layer.known_keys()}
    missing = declared - LAYERS.keys()
    assert not missing, f"list the rules of {missing} in LAYERS of compiler/layers/__init__.py"
    for settings in declared:
        assert rule_of(settings).settings is settings


def test_the_language_lists_every_layer() -> None:
    for kind in Layer.known_keys():
        row = f"| `{kind}` |"
        assert row in _page("language.md"), f"add {row} to the layers of docs/language.md"


def test_the_language_names_every_optimizer() -> None:
    text = _page("language.md")
    for kind in Optimizer.known_keys():
        named = re.search(rf"`{kind}`|optimizer: {{{kind}:|\b{kind} ", text)
        assert named, f"name the optimizer {kind} under Training of docs/language.md"


def test_the_accuracy_of_every_kernel_is_shown() -> None:
    for name in KERNELS:
        measured = _page("kernels.md").count(f"| `{name}` |")
        assert measured >= 2, f"measure {name} with benchmarks/kernel_accuracy for docs/kernels.md"
