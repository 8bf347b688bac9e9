"""Reads the links and joints of a URDF; what is drawn, collided or simulated is left out.

The format: http://wiki.ros.org/urdf/XML. Lengths are m, angles rad, masses kg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import robots as errors
from spec_schema.robots.geometry import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    is_positive,
    product,
    rotation,
    second_moment,
    transposed,
)
from spec_schema.robots.robot import Inertia
from spec_schema.robots.xml_tree import XmlElement, read_xml

MOVING = ("revolute", "continuous", "prismatic")
_XACRO = "write it out by `xacro FILE.xacro > FILE.urdf`"


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A rigid part and its inertia along its own axes; no mass where the file gives none."""

    name: str
    inertia: Inertia
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """What joins a link to its parent: x of the child is R x + r of the parent where it is at 0.

    It turns about a unit vector along the child's axes, or slides along it.
    """

    name: str
    type: str
    parent: str
    child: str
    rotation: Matrix
    offset: Vector
    axis: Vector
    span: Span = field(compare=False)

    @property
    def moves(self) -> bool:
        return self.type in MOVING


@dataclass(frozen=True, slots=True, kw_only=True)
class Urdf:
    """Links and joints by name, in the order of the file."""

    links: dict[str, Link]
    joints: dict[str, Joint]
    span: Span


def read_urdf(source: SourceText, findings: Findings) -> Urdf | None:
    """What a file describes; None once it is reported what keeps it from being read."""
    root = read_xml(source, findings)
    if root is None:
        return None
    foreign = _xacro_element(root)
    if root.tag != "robot" or foreign is not None:
        place = foreign or root
        is_xacro = place.tag.startswith("xacro:")
        repair = _XACRO if is_xacro else "its root is `<robot>`"
        findings.report(errors.not_urdf(f"`<{place.tag}>`", place.span, repair))
        return None
    mark = findings.mark()
    links: dict[str, Link] = {}
    for element in root.all("link"):
        name = _attribute(element, "name", "a link", findings)
        if name in links:
            _report_names("link", name, element.span, links[name].span, findings)
        elif name:
            inertial = _only(element, "inertial", f"the link `{name}`", findings)
            inertia = _inertia(name, inertial, findings)
            links[name] = Link(name=name, inertia=inertia, span=element.span)
    joints: dict[str, Joint] = {}
    for element in root.all("joint"):
        joint = _joint(element, findings)
        if joint is not None and joint.name in joints:
            _report_names("joint", joint.name, element.span, joints[joint.name].span, findings)
        elif joint is not None:
            joints[joint.name] = joint
    for element in root.all("transmission"):
        _look_at_transmission(element, findings)
    if not links and not findings.since(mark):
        findings.report(errors.incomplete_element("the robot", "`<link>`", root.span))
    failed = any(one.severity == "error" for one in findings.since(mark))
    return None if failed else Urdf(links=links, joints=joints, span=root.span)


def _report_names(what: str, name: str, span: Span, first: Span, findings: Findings) -> None:
    findings.report(errors.twice_in_urdf(f"two {what}s are called `{name}`", span, first))


def _xacro_element(root: XmlElement) -> XmlElement | None:
    waiting = [root]
    while waiting:
        element = waiting.pop()
        if element.tag.startswith("xacro:"):
            return element
        waiting += element.children
    return None


def _inertia(link: str, element: XmlElement | None, findings: Findings) -> Inertia:
    """The inertia of a link along the link's axes."""
    if element is None:
        return Inertia()
    what = f"`<inertial>` of `{link}`"
    R, com = _origin(element, what, findings)
    mass_element = _only(element, "mass", what, findings)
    inertia_element = _only(element, "inertia", what, findings)
    if mass_element is None or inertia_element is None:
        missing = "`<mass>`" if mass_element is None else "`<inertia>`"
        findings.report(errors.incomplete_element(what, missing, element.span))
        return Inertia()
    (mass,) = _numbers(mass_element, "value", 1, what, findings) or (math.nan,)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    found = [_numbers(inertia_element, name, 1, what, findings) for name in names]
    if math.isnan(mass) or any(number is None for number in found):
        return Inertia()
    xx, xy, xz, yy, yz, zz = (number[0] for number in found if number is not None)
    moments: Matrix = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    problem, place, repair = None, inertia_element.span, None
    if mass < 0.0:
        problem, place = f"a mass of {mass:g} kg", mass_element.span
    elif mass == 0.0 and any(found for row in moments for found in row):
        problem, repair = "a mass of 0 with moments", "give it a mass, or remove `<inertial>`"
    elif not is_positive(moments):
        problem = "its matrix is not positive, so that it would speed up by itself"
        repair = "the moments are about the centre of mass, ixx and so on the diagonal"
    if problem is not None:
        findings.report(errors.impossible_inertia(link, problem, place, repair))
        return Inertia()
    if mass == 0.0:
        return Inertia()
    spread = second_moment(moments)
    if not is_positive(spread):
        findings.report(errors.unlikely_inertia(link, inertia_element.span))
    return Inertia(mass=mass, com=com, spread=product(product(R, spread), transposed(R)))


def _joint(element: XmlElement, findings: Findings) -> Joint | None:
    name = _attribute(element, "name", "a joint", findings)
    what = f"the joint `{name}`"
    type = _attribute(element, "type", what, findings)
    parent, child = (_named_link(element, tag, what, findings) for tag in ("parent", "child"))
    R, offset = _origin(element, what, findings)
    axis = _axis(element, what, findings) if type in MOVING else (0.0, 0.0, 1.0)
    if type and type not in (*MOVING, "fixed"):
        findings.report(errors.unknown_joint_type(name, type, element.span))
        return None
    mimic, dynamics = (_only(element, tag, what, findings) for tag in ("mimic", "dynamics"))
    if mimic is not None and type in MOVING:
        findings.report(errors.mimicking_joint(name, mimic.span))
    if dynamics is not None and type in MOVING:
        keys = [key for key in ("damping", "friction") if key in dynamics.attributes]
        given = [_numbers(dynamics, key, 1, what, findings) for key in keys]
        if any(number is not None and number[0] != 0.0 for number in given):
            findings.report(errors.unused_friction(name, dynamics.span))
    if not (name and type and parent and child) or axis is None:
        return None
    return Joint(
        name=name,
        type=type,
        parent=parent,
        child=child,
        rotation=R,
        offset=offset,
        axis=axis,
        span=element.span,
    )


def _named_link(element: XmlElement, tag: str, what: str, findings: Findings) -> str:
    found = _only(element, tag, what, findings)
    if found is None:
        findings.report(errors.incomplete_element(what, f"`<{tag} link=…>`", element.span))
        return ""
    return _attribute(found, "link", f"`<{tag}>` of {what}", findings)


def _axis(element: XmlElement, what: str, findings: Findings) -> Vector | None:
    """The unit vector of a joint, by default that of x."""
    found = _only(element, "axis", what, findings)
    if found is None:
        return (1.0, 0.0, 0.0)
    numbers = _numbers(found, "xyz", 3, what, findings)
    if numbers is None:
        return None
    x, y, z = numbers
    length = math.hypot(x, y, z)
    if length == 0.0:
        text = found.attributes["xyz"]
        report = errors.malformed_number("xyz", text, "a direction", found.span)
        findings.report(report)
        return None
    return x / length, y / length, z / length


def _origin(element: XmlElement, what: str, findings: Findings) -> tuple[Matrix, Vector]:
    """Rotation and offset of `<origin xyz rpy>`; none where it is left out."""
    found = _only(element, "origin", what, findings)
    if found is None:
        return IDENTITY, ZERO
    xyz = rpy = ZERO
    if "xyz" in found.attributes:
        x, y, z = _numbers(found, "xyz", 3, "`<origin>`", findings) or ZERO
        xyz = x, y, z
    if "rpy" in found.attributes:
        roll, pitch, yaw = _numbers(found, "rpy", 3, "`<origin>`", findings) or ZERO
        rpy = roll, pitch, yaw
    return rotation(*rpy), xyz


def _look_at_transmission(element: XmlElement, findings: Findings) -> None:
    """Warns of gears: positions and torques of a robot are those of its joints."""
    for part in (*element.all("joint"), *element.all("actuator"), element):
        for ratio in part.all("mechanicalReduction"):
            text = ratio.text.strip()
            if text not in ("", "1", "1.0"):
                name = element.attributes.get("name", "")
                findings.report(errors.transmission_ratio(name, text[:40], ratio.span))


def _only(element: XmlElement, tag: str, what: str, findings: Findings) -> XmlElement | None:
    """The element of a tag that can stand once; the first where it is reported that it does not."""
    found = list(element.all(tag))
    for again in found[1:]:
        said, repair = f"{what} has two `<{tag}>`: which one counts?", "remove one of them"
        findings.report(errors.twice_in_urdf(said, again.span, found[0].span, repair))
    return found[0] if found else None


def _attribute(element: XmlElement, name: str, what: str, findings: Findings) -> str:
    found = element.attributes.get(name, "")
    if not found:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
    return found


def _numbers(
    element: XmlElement, name: str, count: int, what: str, findings: Findings
) -> tuple[float, ...] | None:
    """The finite numbers of an attribute; None once it is reported that there are others."""
    text = element.attributes.get(name)
    if text is None:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
        return None
    try:
        # Python would read 1_0, which no reader of XML takes for a number
        numbers = () if "_" in text else tuple(float(part) for part in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) == count and all(math.isfinite(number) for number in numbers):
        return numbers
    wanted = "a number" if count == 1 else f"{count} numbers"
    findings.report(errors.malformed_number(name, text[:40], wanted, element.span))
    return None
