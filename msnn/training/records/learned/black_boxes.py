"""Finds the layers whose individual weights have no physical meaning."""

from __future__ import annotations

from compiler.elaboration.names import rule_of
from spec_schema.sections.layers import Layer, LocalModel
from spec_schema.sections.spec import Spec


def black_boxes(spec: Spec) -> frozenset[str]:
    """Full names of black-box layers, and of local models with black-box cells."""
    return frozenset(name for name, layer in spec.layers.items() if _is_one(layer))


def _is_one(layer: Layer) -> bool:
    settings = layer.chosen()
    return rule_of(
        settings.cell.chosen() if isinstance(settings, LocalModel) else settings
    ).is_black_box
