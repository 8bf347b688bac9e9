"""Finds the sub-models that a value depends on within the same step."""

from __future__ import annotations

from typing import Any

from compiler.linking.connected import Connected
from spec_schema.expressions.tree import Expression
from spec_schema.sections.references import names_in
from spec_schema.sections.spec import Spec


def needed_submodels(spec: Spec, expression: Expression) -> tuple[str, ...]:
    """The sub-models that an expression of the model depends on without a delay.

    Reading a parameter or a layer of a sub-model does not count: a controller may share them.
    """
    if not spec.use:
        return ()
    needed: dict[str, None] = {}
    seen: set[str] = set()
    waiting: list[Any] = [expression]
    while waiting:
        for name in names_in(waiting.pop()):
            if name in seen:
                continue
            seen.add(name)
            entry = spec.equations.get(name) or spec.outputs.get(name) or spec.states.get(name)
            if entry is not None and "." in name and not isinstance(entry, Connected):
                needed[name.partition(".")[0]] = None
            for section in (spec.equations, spec.outputs, spec.functions):
                if name in section:
                    waiting.append(section[name].expr)
            if name in spec.layers:
                waiting.append(spec.layers[name])
    return tuple(needed)
