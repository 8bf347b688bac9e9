"""Defines robots as a kind of sub-model, for the reader of specs and for saved runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from msnn.features.robots import errors
from msnn.features.robots.urdf.robot_part import robot_part
from msnn.features.robots.urdf.urdf_file import Urdf, read_urdf
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.sections.submodels import PartKind

_Piece = TypeVar("_Piece")


def _difference(before: str, text: str) -> str | None:
    """A text about the first difference of two URDF texts, such as "the link `arm` is another one";
    None if both describe the same robot.

    Comments, names of meshes and other text that no model reads are ignored.
    """
    then, now = _read(before), _read(text)
    if then is None or now is None:
        return "the URDF has another text"
    for kind, old, new in (("link", then.links, now.links), ("joint", then.joints, now.joints)):
        name = _first_differing(old, new)
        if name is not None:
            return f"the {kind} `{name}` is another one"
    # their order is that of the elements of positions and torques
    if list(then.joints) != list(now.joints):
        return "the joints stand in another order"
    return None


def _read(text: str) -> Urdf | None:
    return read_urdf(SourceText("robot.urdf", text), Findings())


def _first_differing(old: Mapping[str, _Piece], new: Mapping[str, _Piece]) -> str | None:
    return next((name for name in {**new, **old} if old.get(name) != new.get(name)), None)


ROBOT = PartKind(
    # a URDF without its meshes, which are files of their own
    largest_file=1_000_000,
    read=robot_part,
    difference=_difference,
    unreadable=errors.unreadable_robot,
    beside_spec=errors.spec_or_robot,
    with_weights=errors.weights_of_robot,
)
