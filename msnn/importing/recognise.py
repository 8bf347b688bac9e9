"""Finds relations that stand for many: local models, integrals and derivatives in time."""

from __future__ import annotations

from collections.abc import Mapping

from msnn.importing.calculus import calculus
from msnn.importing.grammar import File
from msnn.importing.graph import Graph
from msnn.importing.local_models import local_models
from msnn.importing.recognised import Recognised


def recognise(file: File) -> Mapping[str, Recognised]:
    """What the relations are that stand for many."""
    graph = Graph(file)
    return {**calculus(graph), **local_models(graph)}
