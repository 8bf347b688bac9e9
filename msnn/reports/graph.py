"""Draws a spec as a graph of its signals, layers, equations, states and outputs, for Mermaid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from spec_schema.fields.entry import Entry
from spec_schema.sections.references import names_in
from spec_schema.sections.spec import Spec

# What encloses the label of each kind.
_SHAPES = {
    "inputs": ("([", "])"),
    "targets": ("([", "])"),
    "parameters": ("{{", "}}"),
    "layers": ("[[", "]]"),
    "states": ("[(", ")]"),
    "equations": ("[", "]"),
    "outputs": ("([", "])"),
    "losses": (">", "]"),
}


def mermaid_text(spec: Spec) -> str:
    """A flowchart: an arrow from everything that a formula names to what the formula defines.

    A dotted arrow leads from an output to the signal that it predicts.
    """
    kinds = {name: kind for kind in _SHAPES for name in getattr(spec, kind)}
    number = {name: f"n{index}" for index, name in enumerate(kinds)}
    lines = ["flowchart LR"]
    for name, kind in kinds.items():
        opening, closing = _SHAPES[kind]
        lines.append(f'  {number[name]}{opening}"{_label(spec, kind, name)}"{closing}')
    for name, kind in kinds.items():
        for used in dict.fromkeys(_used_by(spec, kind, name)):
            if used in number and (used, kind) != (name, "states"):
                lines.append(f"  {number[used]} --> {number[name]}")
        if kind == "outputs" and (prediction := spec.outputs[name].predicts) is not None:
            signal = prediction.signal.value
            if signal in number:
                lines.append(f"  {number[name]} -. predicts .-> {number[signal]}")
    return "\n".join(lines)


def _label(spec: Spec, kind: str, name: str) -> str:
    entry: Any = getattr(spec, kind)[name]
    unit = getattr(entry, "unit", None)
    about = f" [{unit.value.text}]" if unit is not None else ""
    if kind == "layers":
        layer = spec.layers[name]
        set_fields = (key for key in type(layer).model_fields if key != "place")
        about = f": {next(key for key in set_fields if getattr(layer, key) is not None)}"
    return _escaped(name + about)


def _escaped(text: str) -> str:
    """Entities for what Mermaid or HTML would take for their own."""
    return "".join(c if c.isalnum() or c in " _:." else f"#{ord(c)};" for c in text)


def _formulas(spec: Spec, kind: str, name: str) -> Any:
    entry: Entry = getattr(spec, kind)[name]
    if kind in ("inputs", "targets"):
        return ()
    return tuple(getattr(entry, field) for field in type(entry).model_fields if field != "predicts")


def _used_by(spec: Spec, kind: str, name: str) -> Iterator[str]:
    """Every name that the formulas of an entry use; a function stands for what its formula uses."""
    waiting = list(names_in(_formulas(spec, kind, name)))[::-1]
    while waiting:
        used = waiting.pop()
        yield used
        if used in spec.functions:
            called = spec.functions[used]
            own = {argument.value for argument in called.args}
            waiting += [n for n in names_in(called.expr) if n not in own][::-1]
