"""Finds the sub-models that a value needs in the same step, by what its equations read."""

from __future__ import annotations

from typing import Any

from compiler.linking.connected import Connected
from spec_schema.expressions.tree import Expression
from spec_schema.sections.references import names_in
from spec_schema.sections.spec import Spec


def needed_submodels(spec: Spec, expression: Expression) -> tuple[str, ...]:
    """The sub-models of the model itself that an expression of it needs, through anything but time.

    A parameter or a layer of a sub-model is not the sub-model: a controller may share them.
    """
    if not spec.use:
        return ()
    found: dict[str, None] = {}
    seen: set[str] = set()
    waiting: list[Any] = [expression]
    while waiting:
        for name in names_in(waiting.pop()):
            if name in seen:
                continue
            seen.add(name)
            entry = spec.equations.get(name) or spec.outputs.get(name) or spec.states.get(name)
            if entry is not None and "." in name and not isinstance(entry, Connected):
                found[name.partition(".")[0]] = None
            for section in (spec.equations, spec.outputs, spec.functions):
                if name in section:
                    waiting.append(section[name].expr)
            if name in spec.layers:
                waiting.append(spec.layers[name])
    return tuple(found)
