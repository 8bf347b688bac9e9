"""Lists that people write name everything that the code has; what fails says where to add it."""

from __future__ import annotations

import re
from pathlib import Path

from compiler.kernels.table import KERNELS
from compiler.layers import LAYERS, rule_of
from msnn.cli.application import VERBS
from msnn.data.formats.table_of_formats import FORMATS
from msnn.exports.table import TARGETS
from msnn.packages import OptionalPackage
from spec_schema.fields.entry import kinds_of, kinds_within
from spec_schema.sections.layers import Layer
from spec_schema.sections.optimizers import Optimizer
from spec_schema.sections.spec import Spec
from tests.docs.diagnostics import all_messages
from tests.docs.keys import known_keys
from tests.docs.names import names

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def _page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def test_every_layer_has_its_rule() -> None:
    declared = {kinds_of(Layer.model_fields[kind].annotation)[0] for kind in Layer.known_keys()}
    missing = {kind.__name__ for kind in declared} - LAYERS.keys()
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


def test_the_language_lists_every_data_format() -> None:
    rows = [row for row in _page("language.md").splitlines() if row.startswith("| `.")]
    for format in FORMATS:
        named = any(set(re.findall(r"`(\.\w+)`", row)) >= set(format.suffixes) for row in rows)
        assert named, f"add a row of {format.suffixes} to the files under Data of docs/language.md"


def test_the_readme_names_the_extra_of_every_data_format_and_target() -> None:
    packages: list[OptionalPackage] = [one for format in FORMATS for one in format.packages]
    packages += [one for target in TARGETS for one in (target.writer, target.runner) if one]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for extra in {package.extra for package in packages}:
        assert f"`{extra}`" in text, f"add the extra `{extra}` to the table of extras of README.md"


def test_the_readme_and_the_language_name_every_target() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"`--to` names targets \(([^)]*)\)", readme)
    for target in TARGETS:
        assert f"`{target.name}`" in listed, f"name `{target.name}` under Export of README.md"
        row = f"| `{target.name}`"
        assert row in _page("language.md"), f"add {row} to the targets of docs/language.md"


WRITTEN = "tests/docs/names.py leaves one out of docs/names.md"


def test_the_index_has_every_verb_layer_key_and_message() -> None:
    verbs, layers, keys, messages = names().split("\n## ")
    assert set(re.findall(r"`(\w+)`", verbs)) == set(VERBS), WRITTEN
    assert set(re.findall(r"`(\w+)`", layers)) == set(Layer.known_keys()), WRITTEN
    known = {key for entry in kinds_within(Spec) for key in known_keys(entry)}
    assert set(re.findall(r"^\| `(.+?)` \|", keys, re.MULTILINE)) == known, WRITTEN
    assert set(re.findall(r"`(\w+)`", messages)) == {each.code for each in all_messages()}, WRITTEN


def test_every_page_is_in_the_navigation_once() -> None:
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "how-to").glob("*.md")]
    for page in pages:
        named = f": {page.relative_to(ROOT / 'docs')}\n"
        assert listed.count(named) == 1, f"name {page.name} in mkdocs.yml, once"
