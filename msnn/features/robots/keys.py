"""The keys of a robot in a spec, in addition to its URDF file."""

from dataclasses import field
from typing import Annotated, ClassVar, TypeAlias

from pydantic import Field

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, Named, RefusedError
from spec_schema.fields.leaf import Choice, Located, Spelled
from spec_schema.fields.plain import DifferentOf, LocatedText, located_choice, reads, scalar
from spec_schema.fields.quantities import QUANTITY, read_quantity
from spec_schema.late_dataclass import dataclass
from spec_schema.units.quantity import Quantity
from spec_schema.yaml_tree.nodes import Listing, Node, kind


@dataclass(frozen=True)
class Joints(Spelled):
    """`arm` or `[shoulder, elbow]`: the joints that move, by a dimension's labels or by a list."""

    dimension: Located[str] | None
    labels: tuple[Located[str], ...]
    span: Span = field(compare=False)

    @property
    def spelling(self) -> Located[str] | tuple[Located[str], ...]:
        """The name of the dimension, or the list of joints."""
        return self.dimension or self.labels


def _read_joints(node: Node, findings: Findings) -> Joints:
    if not isinstance(node, Listing):
        name = scalar(node, findings, "a dimension, or a list of joints")
        # whether a dimension of this name has labels is known once the whole spec is read
        return Joints(Located(name.text, name.span, name.key), (), node.span)
    # in the order of the list: it is the order of q, and so of every array of the robot
    labels: dict[str, Located[str]] = {}
    for item in node.items:
        label = scalar(item, findings, "the name of a joint")
        if label.text in labels:
            place = labels[label.text].span
            findings.report(errors.repeated_item(label.text, label.span, place))
        labels[label.text] = Located(label.text, label.span)
    if not labels:
        findings.report(errors.empty_section("a list of joints", node.span))
        raise RefusedError
    return Joints(None, tuple(labels.values()), node.span)


def _read_gravity(node: Node, findings: Findings) -> tuple[Quantity, ...]:
    if not isinstance(node, Listing) or len(node.items) != 3:
        found = "a list of another length" if isinstance(node, Listing) else kind(node)
        repair = "write for example `[0, 0, -9.81]`"
        findings.report(errors.wrong_kind("a list of three numbers", found, node.span, repair))
        raise RefusedError
    return tuple(read_quantity(item, findings) for item in node.items)


def _read_armature(node: Node, findings: Findings) -> tuple[Quantity, ...]:
    # one number counts for all joints; whether a list has the right length only the URDF tells
    items = node.items if isinstance(node, Listing) else (node,)
    if not items:
        findings.report(errors.empty_section("a list of inertias", node.span))
        raise RefusedError
    return tuple(read_quantity(item, findings) for item in items)


_JOINTS = {"type": ["string", "array"], "items": {"type": "string"}, "minItems": 1}
_GRAVITY = {"type": "array", "items": QUANTITY, "minItems": 3, "maxItems": 3}
_ARMATURE = {"type": ["string", "number", "array"], "items": QUANTITY, "minItems": 1}
Learned: TypeAlias = Annotated[Choice[str], located_choice("mass", "com", "inertia")]


class Robot(Entry):
    """A robot from a URDF file; calls such as `arm.mass_matrix(q)` compute its dynamics."""

    noun: ClassVar[str] = "a robot"
    shorthand: ClassVar[str | None] = "urdf"

    urdf: LocatedText
    """URDF file of the robot, relative to this one."""
    joints: Annotated[Joints, reads(_read_joints, _JOINTS)] | None = None
    """Joints that move: a dimension with their names as labels, or a list; by default all."""
    gravity: Annotated[tuple[Quantity, ...], reads(_read_gravity, _GRAVITY)] | None = None
    """Acceleration of free fall along x, y, z of the base; `[0, 0, -9.81]`, in m/s^2."""
    armature: Annotated[tuple[Quantity, ...], reads(_read_armature, _ARMATURE)] | None = None
    """Inertia of the motors seen at the joints, in kg*m^2 (kg where a joint slides)."""
    # None is `fixed`: located where it is given, as messages about joints of the base point there
    base: Annotated[Choice[str], located_choice("fixed", "floating")] | None = None
    """`fixed` (default), or `floating`: a base that moves by six joints, `base_x` … `base_yaw`."""
    frames: Named[LocatedText] = Field(default_factory=dict[str, Located[str]])
    """Links whose position and velocity the spec uses, by name: `arm.tip.position(q)`."""
    learn: DifferentOf[Learned] = ()
    """Learned inertial parameters: `mass`, `com`, `inertia`."""
