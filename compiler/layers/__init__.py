"""Layers: composite operations that expand into core operations, one file each."""

from __future__ import annotations

from compiler.layers.equation_learner import EQUATION_LEARNER
from compiler.layers.fir import FIR
from compiler.layers.fuzzify import FUZZIFY
from compiler.layers.iir import IIR
from compiler.layers.interpolation import INTERPOLATION
from compiler.layers.linear import LINEAR
from compiler.layers.local_model import LOCAL_MODEL
from compiler.layers.mlp import MLP
from compiler.layers.normalize import NORMALIZE
from compiler.layers.rules.layer_rule import AnyRule
from compiler.layers.savitzky_golay import SAVITZKY_GOLAY
from compiler.layers.state_space import STATE_SPACE

LAYERS: tuple[AnyRule, ...] = (
    FIR,
    LINEAR,
    FUZZIFY,
    LOCAL_MODEL,
    MLP,
    EQUATION_LEARNER,
    INTERPOLATION,
    NORMALIZE,
    IIR,
    STATE_SPACE,
    SAVITZKY_GOLAY,
)
"""Every kind of layer; the class of its settings says which one a spec means."""
