"""Fuzzy sets of nnodely at their edges, and sums over them that others read too."""

from __future__ import annotations

from typing import Any

from msnn.features.nnodely.import_model import ImportedModel
from tests.features.nnodely.saved_model import imported_text, saved


def _with_sets(
    centers: list[float], relations: dict[str, Any], outputs: dict[str, str], **more: Any
) -> ImportedModel:
    sets = {
        "centers": centers,
        "dim_out": {"dim": len(centers)},
        "functions": "Rectangular",
        "names": "sets",
    }
    first = {
        "now": ["SamplePart", ["x"], -1, [-1, 0]],
        "sets": ["Fuzzify", ["now"], "FFuzzify1"],
        **{f"set{i}": ["Select", ["sets"], len(centers), i] for i in range(len(centers))},
    }
    model = saved(
        Functions={"FFuzzify1": sets}, Relations={**first, **relations}, Outputs=outputs, **more
    )
    return imported_text(model)


def test_an_edge_belongs_to_the_set_above_it() -> None:
    """nnodely compares with `<` at the end of a box and with `>=` at its beginning."""
    found = _with_sets([1.0, 0.0], {}, {"upper": "set0", "lower": "set1"})
    assert found.spec["outputs"] == {
        "upper": "where(x < 1.5, 1, 0)",
        "lower": "where(x >= -0.5, 1, 0)",
    }


def test_a_sum_that_others_read_stays_a_value_of_its_own() -> None:
    """Cells of a local model that ends in it would have their weights twice."""
    cells = {f"cell{i}": ["Fir", ["now"], f"W{i}", None, 0] for i in range(3)}
    products = {f"product{i}": ["Mul", [f"cell{i}", f"set{i}"]] for i in range(3)}
    sums = {"part": ["Add", ["product0", "product1"]], "whole": ["Add", ["part", "product2"]]}
    weights = {f"W{i}": {"dim": 1, "sw": 1, "values": [[i + 1.0]]} for i in range(3)}
    found = _with_sets(
        [0.0, 1.0, 2.0],
        {**cells, **products, **sums},
        {"p": "part", "w": "whole"},
        Parameters=weights,
    )
    assert sorted(float(v.item()) for v in found.weights.values()) == [1.0, 2.0, 3.0]
