"""Writes small models as nnodely saves them, for tests that change one thing in them."""

from __future__ import annotations

import json
from typing import Any

from msnn.features.nnodely.import_model import ImportedModel, import_text


def saved(**sections: Any) -> dict[str, Any]:
    """A model y = 2 x, with other sections in place of its own."""
    return {
        "Info": {"SampleTime": 0.1},
        "Inputs": {"x": {"dim": 1, "sw": [-1, 0]}},
        "Constants": {"c": {"dim": 1, "values": [2.0]}},
        "Parameters": {},
        "Functions": {},
        "Relations": {"now": ["SamplePart", ["x"], -1, [-1, 0]], "y": ["Mul", ["now", "c"]]},
        "Outputs": {"out": "y"},
        **sections,
    }


def with_function(code: str, name: str = "f", **more: Any) -> dict[str, Any]:
    """A model y = f(x) of a function in Python."""
    function = {"code": code, "name": name, "params_and_consts": [], "map_over_dim": False, **more}
    relations = {
        "now": ["SamplePart", ["x"], -1, [-1, 0]],
        "y": ["ParamFun", ["now"], "FParamFun1"],
    }
    return saved(Functions={"FParamFun1": function}, Relations=relations)


def imported_text(model: dict[str, Any] | str) -> ImportedModel:
    """What is made of a saved model."""
    text = model if isinstance(model, str) else json.dumps(model, indent=1)
    return import_text(text, "model.json", "model")
