"""E1201-E1229, W1201-W1209: robots, their URDF files and calls of their functions."""

from collections.abc import Iterable, Mapping, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def unreadable_robot(path: str, reason: str, span: Span) -> Diagnostic:
    """E1201: a URDF file cannot be read."""
    message = f"cannot read the robot's URDF {path}: {reason}"
    # in a note, not the help line: the reason may be another one, such as a file that is too large
    notes = ("a path is relative to the folder of the file that it stands in",)
    return error("E1201", span, message, "used here", notes=notes)


def not_xml(problem: str, span: Span) -> Diagnostic:
    """E1202: a URDF file is not XML."""
    return error("E1202", span, f"this is not XML: {problem}", "read up to here")


def document_type(span: Span) -> Diagnostic:
    """E1203: a URDF has a document type, which is refused because it can refer to other files."""
    message = "a URDF is read without a document type and its entities"
    return error("E1203", span, message, "begins here", help="remove `<!DOCTYPE …>`")


def not_urdf(found: str, span: Span, repair: str | None) -> Diagnostic:
    """E1204: an XML file is not a URDF."""
    return error("E1204", span, f"this is not a URDF: {found}", "found this", help=repair)


def incomplete_element(element: str, missing: str, span: Span) -> Diagnostic:
    """E1205: an element of a URDF lacks a required attribute or element."""
    return error("E1205", span, f"{element} has no {missing}", "incomplete")


def malformed_number(attribute: str, found: str, wanted: str, span: Span) -> Diagnostic:
    """E1206: an attribute of a URDF contains other text than the expected numbers."""
    message = f"`{attribute}` is {wanted}, not `{found}`"
    return error("E1206", span, message, f"expected {wanted}")


def unknown_link(name: str, of: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1207: a URDF refers to a link that it does not define."""
    meant = did_you_mean(nearest(name, known))
    return error("E1207", span, f"{of}: there is no link `{name}`", "names it", help=meant)


def not_a_tree(problem: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E1208: the links of a URDF do not form one tree."""
    return error("E1208", span, f"the links are no tree: {problem}", "found here", help=repair)


def unknown_joint_type(name: str, found: str, span: Span) -> Diagnostic:
    """E1209: a joint has an unsupported type."""
    message = f"the joint `{name}` is of the type `{found}`"
    # what robots do have can be composed to the same motion; an unknown type has no such recipe
    repair = {
        "floating": "make its child the root, and write `base: floating` in the spec",
        "planar": "write two prismatic joints and a revolute one, with links without mass between",
        "spherical": "write three revolute joints, with links without mass between",
    }.get(found)
    # the label lists what there is, so the help line is free for how to compose the motion
    known = "one of revolute, continuous, prismatic, fixed"
    return error("E1209", span, message, known, help=repair)


def impossible_inertia(link: str, problem: str, span: Span, repair: str | None) -> Diagnostic:
    """E1210: a mass or an inertia is physically impossible."""
    return error("E1210", span, f"the inertia of `{link}`: {problem}", "given here", help=repair)


def twice_in_urdf(message: str, span: Span, first: Span, repair: str | None = None) -> Diagnostic:
    """E1211: two links or joints have the same name, or an element is repeated."""
    return error(
        "E1211", span, message, "again here", secondary=((first, "the first"),), help=repair
    )


def mimicking_joint(name: str, leader: str, span: Span, others: Sequence[str]) -> Diagnostic:
    """E1212: a joint mimics another joint, which moves."""
    # `others` are the joints that move too
    message = f"the joint `{name}` mimics `{leader}`, which is not in this version"
    held = (
        f"list the other joints in the entry of the robot, `joints: [{', '.join(others)}]`, which "
        f"holds `{name}` and `{leader}`; or "
        if others
        else ""
    )
    repair = (
        f'{held}make `{name}` `type="fixed"`; or remove `<mimic>` and drive it by a torque of its '
        "own"
    )
    return error("E1212", span, message, "follows a joint", help=repair)


def moves_without_mass(joint: str, span: Span) -> Diagnostic:
    """E1213: no mass moves with a joint, so its acceleration is undetermined."""
    message = f"nothing that moves with the joint `{joint}` resists it"
    repair = "give a link behind it mass and inertia, make the joint fixed, or set `armature:`"
    return error("E1213", span, message, "its acceleration is not determined", help=repair)


def unknown_joint(name: str, why: str | None, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1214: the spec lists a joint that the robot lacks, or that cannot move."""
    message = f"the robot has no joint `{name}`" if why is None else f"the joint `{name}` {why}"
    # a joint that is there and does not move was not misspelt
    meant = did_you_mean(nearest(name, known)) if why is None else None
    return error("E1214", span, message, "listed here", help=meant)


def unfit_joints(problem: str, span: Span, labels: Sequence[str]) -> Diagnostic:
    """E1215: the joints of the spec do not fit the robot."""
    listed = ", ".join(labels)
    return error("E1215", span, problem, "these joints", help=f"write `[{listed}]`")


def unfit_setting_of_robot(key: str, problem: str, span: Span, repair: str) -> Diagnostic:
    """E1216: a setting does not fit the robot."""
    return error("E1216", span, f"`{key}` {problem}", "this setting", help=repair)


def unlearnable_inertia(link: str, span: Span, learned: Span) -> Diagnostic:
    """E1217: a link has no extent in one direction, so learning its inertia cannot start."""
    message = f"learning cannot start from the inertia of `{link}`: it has no extent in a direction"
    second = ((learned, "to be learned"),)
    repair = "write an inertia whose principal moments are each below the sum of the others"
    return error("E1217", span, message, "flat or a point", secondary=second, help=repair)


def unknown_robot_member(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1218: a robot does not have a member of this name."""
    # the last dot: the robot may be a member of a sub-model itself
    base, _, member = name.rpartition(".")
    known = tuple(known)
    notes = (f"it has {', '.join(known)}",)
    if member in known:
        message, repair = f"`{name}` is no value by itself", f"call it: `{name}(q)`"
        return error("E1218", span, message, "of a robot", notes=notes, help=repair)
    repair = did_you_mean(nearest(member, known))
    message = f"the robot `{base}` has no `{member}`"
    return error("E1218", span, message, "no such member", notes=notes, help=repair)


def argument_of_robot(
    member: str, argument: str, wanted: str, found: str, span: Span
) -> Diagnostic:
    """E1219: an argument has other axes than the joints."""
    message = f"`{argument}` of `{member}` is along {wanted}, not {found}"
    return error("E1219", span, message, f"this is {found}")


def spec_or_robot(span: Span) -> Diagnostic:
    """E1220: a sub-model is both a spec and a robot."""
    message = "a sub-model is either a spec or a robot"
    return error("E1220", span, message, "both", help="use two sub-models")


def weights_of_robot(span: Span) -> Diagnostic:
    """E1221: weights are given for a robot, which has no weights of its own."""
    message = "a robot has no weights of its own"
    repair = "what it learns is in the weights of the model that uses it"
    return error("E1221", span, message, "for a robot", help=repair)


def crossed_limits(joint: str, lower: float, upper: float, span: Span) -> Diagnostic:
    """E1225: the lower limit of a joint is above the upper one."""
    message = f"the joint `{joint}` cannot move: its limits begin at {lower:g} and end at {upper:g}"
    return error("E1225", span, message, "`lower` is above `upper`", help="exchange them")


def joint_of_base(joint: str, span: Span, base: Span) -> Diagnostic:
    """E1226: a joint of a URDF has the name of a joint of the floating base."""
    message = f"the joint `{joint}` has the name of a joint of the floating base"
    second = ((base, "brings it along"),)
    repair = "give it another name"
    return error("E1226", span, message, "the second one", secondary=second, help=repair)


def rotation_as_quaternion(span: Span) -> Diagnostic:
    """E1227: a rotation is given as a quaternion, which is not supported."""
    message = "a rotation as `quat_xyzw` is not in this version"
    return error("E1227", span, message, "a quaternion", help="write it as `rpy`, in rad")


def held_joints(positions: Mapping[str, float], span: Span, place: Span) -> Diagnostic:
    """W1201: joints that the spec does not list are held at 0, or where `<mimic>` puts them."""
    # at 0, of which -0 is one too, they are only listed; other places are said with their number
    resting = [f"`{name}`" for name, position in positions.items() if position == 0.0]
    others = [f"`{name}` at {position:g}" for name, position in positions.items() if position]
    at_rest = [f"at 0: {', '.join(resting)}"] if resting else []
    plural = "s" if len(positions) > 1 else ""
    message = f"joint{plural} held {'; '.join([*at_rest, *others])}"
    second = ((span, "not among these"),)
    repair = 'list it, or make it `type="fixed"` in the URDF'
    return warning("W1201", place, message, "moves in the URDF", secondary=second, help=repair)


def unused_friction(joints: Sequence[str], span: Span) -> Diagnostic:
    """W1202: friction in a URDF is ignored; the spec must define it."""
    listed = ", ".join(f"`{joint}`" for joint in joints)
    message = f"damping and friction of the joint{'s' * (len(joints) > 1)} {listed} are not used"
    repair = "subtract them from the torque in the spec, and remove them here"
    return warning("W1202", span, message, "left out", help=repair)


def transmission_ratio(name: str, ratio: str, span: Span) -> Diagnostic:
    """W1203: a gear in a URDF is ignored; positions and torques are those of the joints."""
    message = f"the transmission `{name}` has a reduction of {ratio}, which is not used"
    repair = "positions and torques are those of the joints, after the gear: convert them before"
    return warning("W1203", span, message, "left out", help=repair)


def unlikely_inertia(link: str, span: Span) -> Diagnostic:
    """W1204: one principal moment of inertia exceeds the sum of the others."""
    message = f"no body has the inertia of `{link}`: one principal moment exceeds the others' sum"
    notes = ("it is used as it stands",)
    return warning("W1204", span, message, "given here", notes=notes)
