"""An index of every verb, layer, key and message, each with the place that explains it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from spec_schema.fields.entry import kinds_within
from spec_schema.sections.layers import Layer
from spec_schema.sections.spec import Spec
from tests.docs.diagnostics import all_messages
from tests.docs.keys import known_keys, link
from tests.docs.markdown import apart, table, wrapped

_COMMANDS = Path(__file__).parents[2] / "docs" / "cli.md"


def names() -> str:
    """A section of each kind, in the order of the alphabet."""
    return apart(
        "## Verbs",
        _linked(_verbs()),
        "## Layers",
        _linked((kind, f"layers.md#{kind}") for kind in sorted(Layer.known_keys())),
        "## Keys",
        table(("key", "of"), _keys()),
        "## Messages",
        _linked(
            (code, f"../spec_schema/explanations/{code}.md")
            for code in sorted({message.code for message in all_messages()})
        ),
    )


def _verbs() -> list[tuple[str, str]]:
    headings = re.findall(r"^## `(msnn (\w+).*)`$", _COMMANDS.read_text("utf-8"), re.MULTILINE)
    return sorted((verb, f"cli.md#{_anchor(heading)}") for heading, verb in headings)


def _anchor(heading: str) -> str:
    """As code hosts and the site make it of a heading."""
    return re.sub(r"[^\w\s-]", "", heading.lower()).strip().replace(" ", "-")


def _keys() -> list[tuple[str, str]]:
    places: dict[str, list[str]] = {}
    for entry in kinds_within(Spec):
        for key in known_keys(entry):
            places.setdefault(key, []).append(link(entry, "keys.md"))
    return [(f"`{key}`", ", ".join(places[key])) for key in sorted(places)]


def _linked(pairs: Iterable[tuple[str, str]]) -> str:
    return wrapped(" · ".join(f"[`{name}`]({target})" for name, target in pairs))
