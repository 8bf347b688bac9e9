"""Reads the links and joints of a URDF; elements for drawing, collision and simulation are ignored.

The format: http://wiki.ros.org/urdf/XML. Lengths are in m, angles in rad, masses in kg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from msnn.features.robots import errors
from msnn.features.robots.urdf.elements import (
    LARGEST,
    XmlElement,
    attribute_of,
    axis_of,
    numbers_of,
    only_element,
    origin_of,
    read_xml,
)
from msnn.features.robots.urdf.geometry import (
    Matrix,
    Vector,
    is_positive,
    product,
    second_moment,
    transposed,
)
from msnn.features.robots.urdf.robot import Inertia
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span

MOVING = ("revolute", "continuous", "prismatic")
_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
"""The element names of ROS 1 and ROS 2."""
_XACRO = "write it out by `xacro FILE.xacro > FILE.urdf`"


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A rigid part and its inertia along its own axes; mass 0 if the file gives none."""

    name: str
    inertia: Inertia
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mimic:
    """Couples a joint to the one named `joint`, at q: its position is multiplier · q + offset."""

    joint: str
    multiplier: float
    offset: float
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """Joins a link to its parent: at position 0, a point x of the child is R x + r in the parent's
    frame.

    It turns about the unit vector `axis` along the child's axes, or slides along it.
    """

    name: str
    type: str
    parent: str
    child: str
    rotation: Matrix
    offset: Vector
    axis: Vector
    mimic: Mimic | None
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
    """The links and joints of a URDF text; None after reporting errors."""
    root = read_xml(source, findings)
    if root is None:
        return None
    macro = _xacro_element(root)
    if root.tag != "robot" or macro is not None:
        place = macro or root
        repair = _XACRO if macro is not None else "its root is `<robot>`"
        findings.report(errors.not_urdf(f"`<{place.tag}>`", place.span, repair))
        return None
    mark = findings.mark()
    links: dict[str, Link] = {}
    for element in root.all("link"):
        name = attribute_of(element, "name", "a link", findings)
        if name in links:
            _report_names("link", name, element.span, links[name].span, findings)
        elif name:
            inertial = only_element(element, "inertial", f"the link `{name}`", findings)
            inertia = _inertia(name, inertial, findings)
            links[name] = Link(name=name, inertia=inertia, span=element.span)
    joints: dict[str, Joint] = {}
    rubbing: dict[str, Span] = {}
    for element in root.all("joint"):
        joint = _joint(element, rubbing, findings)
        if joint is not None and joint.name in joints:
            _report_names("joint", joint.name, element.span, joints[joint.name].span, findings)
        elif joint is not None:
            joints[joint.name] = joint
    if rubbing:
        findings.report(errors.unused_friction(tuple(rubbing), next(iter(rubbing.values()))))
    # ROS 1 has transmissions in the robot, ROS 2 in its description of the hardware
    for around in (root, *root.all("ros2_control")):
        for element in around.all("transmission"):
            _look_at_transmission(element, findings)
    if not links and not findings.since(mark):
        findings.report(errors.incomplete_element("the robot", "`<link>`", root.span))
    # warnings alone do not keep a robot from being read
    failed = any(one.severity == "error" for one in findings.since(mark))
    return None if failed else Urdf(links=links, joints=joints, span=root.span)


def _report_names(what: str, name: str, span: Span, first: Span, findings: Findings) -> None:
    findings.report(errors.twice_in_urdf(f"two {what}s are called `{name}`", span, first))


def _xacro_element(root: XmlElement) -> XmlElement | None:
    """An element of xacro's namespace, whatever its prefix in the file; None if there is none."""
    waiting = [(root, frozenset(["xacro"]))]
    while waiting:
        element, prefixes = waiting.pop()
        # http://www.ros.org/wiki/xacro, or without www.
        prefixes |= {
            key.removeprefix("xmlns:")
            for key, value in element.attributes.items()
            if key.startswith("xmlns:") and value.rstrip("/").endswith("/xacro")
        }
        prefix, colon, _ = element.tag.partition(":")
        if colon and prefix in prefixes:
            return element
        waiting += [(child, prefixes) for child in element.children]
    return None


def _inertia(link: str, element: XmlElement | None, findings: Findings) -> Inertia:
    """The inertia of a link along the link's axes, from its `<inertial>` element; without mass if
    there is none or after reporting an error.
    """
    if element is None:
        return Inertia()
    what = f"`<inertial>` of `{link}`"
    R, com = origin_of(element, what, findings)
    mass_element = only_element(element, "mass", what, findings)
    inertia_element = only_element(element, "inertia", what, findings)
    if mass_element is None or inertia_element is None:
        missing = "`<mass>`" if mass_element is None else "`<inertia>`"
        findings.report(errors.incomplete_element(what, missing, element.span))
        return Inertia()
    # nan only marks that the mass was no number, which is reported already
    (mass,) = numbers_of(mass_element, "value", 1, what, findings) or (math.nan,)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    found = [numbers_of(inertia_element, name, 1, what, findings) for name in names]
    if math.isnan(mass) or any(number is None for number in found):
        return Inertia()
    xx, xy, xz, yy, yz, zz = (number[0] for number in found if number is not None)
    moments: Matrix = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    problem, place, repair = None, inertia_element.span, None
    if mass < 0.0:
        # a faulty mass or matrix is reported once, the first fault that holds
        problem, place = f"a mass of {mass:g} kg", mass_element.span
    elif mass == 0.0 and any(found for row in moments for found in row):
        problem, repair = "a mass of 0 with moments", "give it a mass, or remove `<inertial>`"
    elif not is_positive(moments):
        problem = "its matrix is not positive, so that it would speed up by itself"
        repair = "the moments are about the centre of mass, ixx and so on the diagonal"
    if problem is not None:
        findings.report(errors.impossible_inertia(link, problem, place, repair))
        return Inertia()
    # a link without mass: where its centre is does not matter
    if mass == 0.0:
        return Inertia()
    spread = second_moment(moments)
    # moments that no mass has, a ≤ b + c broken: simulators take such files, so it is a warning
    if not is_positive(spread):
        findings.report(errors.unlikely_inertia(link, inertia_element.span))
    # the matrix is along the axes of `<inertial>`: turned into those of the link
    return Inertia(mass=mass, com=com, spread=product(product(R, spread), transposed(R)))


def _joint(element: XmlElement, rubbing: dict[str, Span], findings: Findings) -> Joint | None:
    name = attribute_of(element, "name", "a joint", findings)
    what = f"the joint `{name}`"
    type = attribute_of(element, "type", what, findings)
    parent, child = (_named_link(element, tag, what, findings) for tag in ("parent", "child"))
    R, offset = origin_of(element, what, findings)
    # a joint that does not move has an axis by the format, which nothing reads
    axis = axis_of(element, what, findings) if type in MOVING else (0.0, 0.0, 1.0)
    if type and type not in (*MOVING, "fixed"):
        findings.report(errors.unknown_joint_type(name, type, element.span))
        return None
    mimic, dynamics, limit = (
        only_element(element, tag, what, findings) for tag in ("mimic", "dynamics", "limit")
    )
    if dynamics is not None and type in MOVING:
        given = _given(dynamics, ("damping", "friction"), what, findings)
        if any(number != 0.0 for number in given.values()):
            rubbing[name] = dynamics.span
    if limit is not None and type in MOVING:
        _look_at_limits(limit, name, type, findings)
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
        mimic=None if mimic is None else _mimic(mimic, name, findings),
        span=element.span,
    )


def _mimic(element: XmlElement, joint: str, findings: Findings) -> Mimic:
    what = f"`<mimic>` of `{joint}`"
    given = {"multiplier": 1.0, "offset": 0.0}
    given |= _given(element, ("multiplier", "offset"), what, findings)
    leader = attribute_of(element, "joint", what, findings)
    return Mimic(joint=leader, span=element.span, **given)


def _named_link(element: XmlElement, tag: str, what: str, findings: Findings) -> str:
    found = only_element(element, tag, what, findings)
    if found is None:
        findings.report(errors.incomplete_element(what, f"`<{tag} link=…>`", element.span))
        return ""
    return attribute_of(found, "link", f"`<{tag}>` of {what}", findings)


def _given(
    element: XmlElement,
    names: Sequence[str],
    what: str,
    findings: Findings,
    *,
    largest: float = LARGEST,
) -> dict[str, float]:
    """The values of those of the attributes `names` that the element has; reports those that are
    not numbers.
    """
    found: dict[str, float] = {}
    for name in names:
        if name in element.attributes:
            number = numbers_of(element, name, 1, what, findings, largest=largest)
            if number is not None:
                found[name] = number[0]
    return found


def _look_at_limits(element: XmlElement, joint: str, type: str, findings: Findings) -> None:
    """Reports crossed limits of a joint; nothing else uses limits."""
    names = ("lower", "upper", "effort", "velocity")
    given = _given(element, names, f"`<limit>` of `{joint}`", findings, largest=math.inf)
    # what turns endlessly has neither, whatever the file says of them
    if type != "continuous" and given.get("lower", -math.inf) > given.get("upper", math.inf):
        report = errors.crossed_limits(joint, given["lower"], given["upper"], element.span)
        findings.report(report)


def _look_at_transmission(element: XmlElement, findings: Findings) -> None:
    """Warns about gears, since positions and torques of a robot are those of its joints."""
    for part in (*element.all("joint"), *element.all("actuator"), element):
        for tag in _REDUCTIONS:
            for ratio in part.all(tag):
                text = ratio.text.strip()
                if text and not _is_one(text):
                    name = element.attributes.get("name", "")
                    findings.report(errors.transmission_ratio(name, text[:40], ratio.span))


def _is_one(text: str) -> bool:
    try:
        return float(text) == 1.0
    except ValueError:
        return False
