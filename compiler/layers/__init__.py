"""The layers of the language, one file each: composite operations that expand into core
operations.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module

from compiler.layers.rules.layer_rule import AnyRule
from spec_schema import registry
from spec_schema.fields.entry import Entry

LAYERS: Mapping[str, str] = {
    "Fir": "fir",
    "Linear": "linear",
    "Fuzzify": "fuzzify",
    "LocalModel": "local_model",
    "Mlp": "mlp",
    "EquationLearner": "equation_learner",
    "Interpolation": "interpolation",
    "Normalize": "normalize",
    "Iir": "iir",
    "StateSpace": "state_space",
    "SavitzkyGolay": "savitzky_golay",
}
"""The file of each kind of layer, by the name of the class of its settings. The rule in the file
has the file's name in capitals. A file is imported with the first layer of its kind, since most
specs have one kind or none."""


@cache
def rule_of(settings: type[Entry]) -> AnyRule:
    """The rule, an object with the functions that read and expand a layer, for layers whose
    settings have this class. The file of the layer is imported first.
    """
    for line in registry.LAYERS:
        if line.entry.kind is settings:
            # specs without plug-ins do not need it
            from compiler.layers.rules.plugin_layers import rule_of_plugin

            return rule_of_plugin(line)
    name = LAYERS[settings.__name__]
    rule: AnyRule = getattr(import_module(f"{__name__}.{name}"), name.upper())
    assert rule.settings is settings, name
    return rule
