"""Finds groups of relations: local models, time integrals and derivatives."""

from __future__ import annotations

from collections.abc import Mapping

from msnn.features.nnodely.recognition.calculus import calculus
from msnn.features.nnodely.recognition.local_models import local_models
from msnn.features.nnodely.recognition.recognised import Recognised
from msnn.features.nnodely.saved_file.grammar import File
from msnn.features.nnodely.saved_file.graph import Graph


def recognise(file: File) -> Mapping[str, Recognised]:
    """Finds the final relations of recognised groups."""
    graph = Graph(file)
    # of a relation that is both, the local model stands
    return {**calculus(graph), **local_models(graph)}
