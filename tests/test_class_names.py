"""A public class name means one thing in the whole product (decision 0296)."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("spec_schema", "compiler", "backends", "msnn")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# nodes of trees of several languages: formulas of a spec, core operations, routines of kernels, C,
# terms of saved models; each is read beside the name of its language
OF_LANGUAGES = _words(
    """
    Assign Binary Call Compare Constant Convert Formula Function Graph Member Name Named Negate
    Number Operator Real Relation Select Signal Table Truth Unary Unsigned Value Window
    """
)
# what a spec says, and the same as a program or a run has it
OF_SPECS = _words(
    """
    Dimension Filter Input InteriorPoint KalmanFilter Lesson Loss Measurement Method
    MovingHorizon Output Parameter Prediction Prior Robot Rollout State
    """
)


def test_a_class_name_has_one_meaning() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    twice = {name: found for name, found in places.items() if len(found) > 1}
    told = OF_LANGUAGES | OF_SPECS
    new = [f"{name}: {', '.join(found)}" for name, found in twice.items() if name not in told]
    assert not new, (
        "rename one of each, or say in tests/test_class_names.py why not:\n" + "\n".join(new)
    )
