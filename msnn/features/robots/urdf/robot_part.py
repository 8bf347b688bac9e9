"""Builds a robot from a URDF and its entry in a spec, and the spec of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from msnn.features.robots import errors
from msnn.features.robots import keys as sections
from msnn.features.robots.urdf.bodies import Tree, held_positions, tree_of
from msnn.features.robots.urdf.geometry import (
    Vector,
    cholesky,
    multiple,
    product,
    times,
    transposed,
)
from msnn.features.robots.urdf.robot import BASE_JOINTS, Body, BodyPoint, Robot
from msnn.features.robots.urdf.urdf_file import Urdf, read_urdf
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.fields.leaf import Located
from spec_schema.sections.submodels import PartRead, SpecAround
from spec_schema.units.parser import parse_unit
from spec_schema.units.quantity import Quantity, converted
from spec_schema.units.unit import Unit
from spec_schema.yaml_tree.nodes import Listing, Node, Positions, Scalar, Table

# along the axes of the world, z up; m/s²
_GRAVITY = (0.0, 0.0, -9.81)
_ACCELERATION = parse_unit("m/s^2")
_TURNING, _SLIDING = parse_unit("kg*m^2"), parse_unit("kg")
_WEIGHTLESS = "has nothing to begin from: no link that moves has a mass"
_SPACE = ("x", "y", "z")


def robot_part(
    entry: sections.Robot,
    source: SourceText,
    name: str,
    around: SpecAround,
    findings: Findings,
) -> PartRead[Robot] | None:
    """The robot of the URDF text `source` for the entry of a spec, and the spec of its parameters;
    None after reporting errors.
    """
    mark = findings.mark()
    urdf = read_urdf(source, findings)
    if urdf is None:
        return None
    labels = _labels(entry, urdf, around, findings)
    floats = entry.base is not None and entry.base.value == "floating"
    held = held_positions(urdf, labels, findings)
    tree = tree_of(urdf, labels, held, floats=floats, findings=findings)
    if tree is None or any(one.severity == "error" for one in findings.since(mark)):
        return None
    # joints of the file that `joints:` leaves out do not move: a warning, no error
    if held:
        place, first = (entry.joints or entry.urdf).span, next(iter(held))
        findings.report(errors.held_joints(held, place, urdf.joints[first].span))
    if not tree.bodies:
        problem, repair = (
            "moves by no joint",
            "give it a joint that is not fixed, or `base: floating`",
        )
        findings.report(errors.unfit_setting_of_robot("urdf", problem, entry.urdf.span, repair))
        return None
    slides = {body.joint: body.slides for body in tree.bodies}
    positions = tuple(labels.index(body.joint) for body in tree.bodies)
    armature = _armature(entry, [slides[label] for label in labels], findings)
    frames = _frames(entry, tree, findings)
    dimension = entry.joints.dimension if entry.joints is not None else None
    robot = Robot(
        bodies=tree.bodies,
        positions=positions,
        gravity=_gravity(entry, findings),
        armature=armature,
        frames=frames,
        learned=frozenset(one.value for one in entry.learn),
        joint=dimension.value if dimension is not None else "joint",
    )
    described = _described(robot, labels, name, around, urdf, entry, findings)
    if any(one.severity == "error" for one in findings.since(mark)):
        return None
    return PartRead(robot, described)


def _labels(
    entry: sections.Robot, urdf: Urdf, around: SpecAround, findings: Findings
) -> tuple[str, ...]:
    """The names of the moving joints, in the order of q: those of the entry's `joints`, or of a
    floating base and the file. Reports names that do not fit.
    """
    base: tuple[str, ...] = ()
    if entry.base is not None and entry.base.value == "floating":
        base = BASE_JOINTS
        for joint in urdf.joints.values():
            if joint.moves and joint.name in base:
                report = errors.joint_of_base(joint.name, joint.span, entry.base.span)
                findings.report(report)
    own = tuple(joint.name for joint in urdf.joints.values() if joint.moves)
    known = (*base, *own)
    if entry.joints is None:
        return known
    place = entry.joints.span
    if entry.joints.dimension is not None:
        dimension = around.dims.get(entry.joints.dimension.value)
        if dimension is None:
            problem = f"there is no dimension `{entry.joints.dimension.value}`"
            findings.report(errors.unfit_joints(problem, place, known))
            return known
        if not dimension.labels:
            # a dimension without labels takes the joints in the order of the file
            if dimension.size != len(known):
                problem = f"the dimension has {dimension.size} elements, the robot {len(known)}"
                findings.report(errors.unfit_joints(problem, place, known))
            return known
        given = tuple(Located(label, dimension.place.value) for label in dimension.labels)
    else:
        given = entry.joints.labels
    labels = tuple(label.value for label in given)
    # `_armature` counts on the six joints of the base being the first of q
    if labels[: len(base)] != base:
        problem = f"the joints of a floating base come first: {', '.join(base)}"
        findings.report(errors.unfit_joints(problem, place, known))
        return known
    for label in given[len(base) :]:
        joint = urdf.joints.get(label.value)
        if joint is None or not joint.moves:
            why = None if joint is None else f"is of the type `{joint.type}` and does not move"
            findings.report(errors.unknown_joint(label.value, why, label.span, own))
    return labels


def _gravity(entry: sections.Robot, findings: Findings) -> Vector:
    x, y, z = _GRAVITY
    if entry.gravity is not None:
        x, y, z = (_in(part, _ACCELERATION, findings) for part in entry.gravity)
    return x, y, z


def _armature(
    entry: sections.Robot, slides: Sequence[bool], findings: Findings
) -> tuple[float, ...]:
    """The motor inertia of each joint in the order of q, in kg m², or in kg for one that slides. It
    is 0 for joints of a floating base; a single value holds for all others. Reports wrong numbers
    and negative ones.
    """
    if entry.armature is None:
        return (0.0,) * len(slides)
    floats = entry.base is not None and entry.base.value == "floating"
    free = len(BASE_JOINTS) if floats else 0
    given = entry.armature
    if len(given) == 1:
        # six joints of a floating base have no motor
        given = given * (len(slides) - free)
    place = entry.armature[0].span
    if len(given) != len(slides) - free:
        problem = f"has {len(given)} numbers, one for each joint are {len(slides) - free}"
        repair = "write one number for all joints, or one for each in their order"
        findings.report(errors.unfit_setting_of_robot("armature", problem, place, repair))
        return (0.0,) * len(slides)
    units = (_SLIDING if sliding else _TURNING for sliding in slides[free:])
    found = [_in(part, unit, findings) for part, unit in zip(given, units, strict=True)]
    if any(number < 0.0 for number in found):
        problem, repair = "must be at least 0", "leave `armature:` out where it is not known"
        findings.report(errors.unfit_setting_of_robot("armature", problem, place, repair))
    return (*(0.0,) * free, *found)


def _in(quantity: Quantity, unit: Unit, findings: Findings) -> float:
    number = converted(quantity, unit, findings)
    return quantity.value if number is None else number


def _frames(entry: sections.Robot, tree: Tree, findings: Findings) -> Mapping[str, BodyPoint]:
    found: dict[str, BodyPoint] = {}
    for name, link in entry.frames.items():
        if link.value in tree.links:
            found[name] = tree.links[link.value].place()
        else:
            report = errors.unknown_link(link.value, f"`{name}`", link.span, tree.links)
            findings.report(report)
    return found


def _described(
    robot: Robot,
    labels: Sequence[str],
    name: str,
    around: SpecAround,
    urdf: Urdf,
    entry: sections.Robot,
    findings: Findings,
) -> Node:
    """The spec of a robot's dimensions and parameters, as a YAML tree whose places are that of the
    URDF. Reports a robot that learns without a mass.
    """
    place = urdf.span
    dims: dict[str, object] = {robot.joint: list(labels), "joint2": list(labels)}
    dims["xyz"] = list(_SPACE)
    parameters: dict[str, object] = {}
    if robot.learned:
        heavy = [robot.bodies[index] for index in robot.heavy]
        if not heavy:
            place_of_learn, repair = entry.learn[0].span, "give a link that moves its `<inertial>`"
            findings.report(
                errors.unfit_setting_of_robot("learn", _WEIGHTLESS, place_of_learn, repair)
            )
            return _node({"msnn": 1, "name": name}, place)
        dims["body"] = [body.link for body in heavy]
        parameters = _parameters(robot, heavy, urdf, entry, findings)
    data: dict[str, object] = {
        "msnn": 1,
        "name": name,
        "dims": dims,
        "inputs": {},
        "parameters": parameters,
        "outputs": {},
    }
    if around.sample_time is not None:
        data["sample_time"] = around.sample_time.text
    return _node(data, place)


def _parameters(
    robot: Robot, heavy: Sequence[Body], urdf: Urdf, entry: sections.Robot, findings: Findings
) -> dict[str, object]:
    """The entries of the learned parameters with initial values: mass, centre, and size and shear
    of the second moment of each body in `heavy`, along its link's axes.
    """
    masses = [body.inertia.mass for body in heavy]
    # the URDF gives them along the axes of links, bodies have the joint's axis as z
    centres = [list(times(body.axes, body.inertia.com)) for body in heavy]
    sizes: list[list[float]] = []
    shears: list[list[float]] = []
    for body in heavy if "inertia" in robot.learned else ():
        # heavy bodies alone have parameters, so that the quotient exists
        spread = multiple(1 / body.inertia.mass, body.inertia.spread)
        # The second moment per mass as L Lᵀ: its diagonal (`size`) stays positive while it is
        # learned, so that no training leaves the possible bodies (decision 0242).
        L = cholesky(product(product(body.axes, spread), transposed(body.axes)))
        # below a millionth of a metre a body is flat: its L has no positive diagonal to learn
        if L is None or min(L[i][i] for i in range(3)) < 1e-6:
            place = next(one.span for one in entry.learn if one.value == "inertia")
            link = urdf.links[body.link]
            findings.report(errors.unlearnable_inertia(body.link, link.span, place))
            continue
        sizes.append([L[0][0], L[1][1], L[2][2]])
        shears.append([L[1][0], L[2][0], L[2][1]])
    found: dict[str, object] = {}
    if "mass" in robot.learned:
        found["mass"] = {"init": masses, "min": 0, "unit": "kg", "dims": "body"}
    if "com" in robot.learned:
        found["com"] = {"init": centres, "unit": "m", "dims": ["body", "xyz"]}
    if "inertia" in robot.learned:
        dims = ["body", "xyz"]
        found["size"] = {"init": sizes, "min": 0, "unit": "m", "dims": dims}
        found["shear"] = {"init": shears, "unit": "m", "dims": dims}
    return found


def _node(value: object, span: Span) -> Node:
    """Data as a YAML tree in which every node has the place `span`."""
    if isinstance(value, dict):
        table = cast("dict[str, object]", value)
        entries = {key: _node(item, span) for key, item in table.items()}
        return Table(entries, dict.fromkeys(entries, span), span, span)
    if isinstance(value, list):
        items = cast("list[object]", value)
        return Listing(tuple(_node(item, span) for item in items), span, span)
    assert isinstance(value, int | float | str)
    text = repr(value) if isinstance(value, float) else str(value)
    # no text to point into: every character is at the place of the URDF
    positions = _OnePlace(SourceText(span.file, ""), (0,) * (len(text) + 1), span)
    return Scalar(text=text, value=value, quoted=False, positions=positions, span=span, key=span)


@dataclass(frozen=True)
class _OnePlace(Positions):
    """Text that is not in a file; all of it has the position from which it was generated."""

    place: Span

    def span(self, first: int, last: int) -> Span:
        del first, last
        return self.place

    def part(self, first: int, last: int) -> Positions:
        return _OnePlace(self.source, self.offsets[first : last + 1], self.place)
