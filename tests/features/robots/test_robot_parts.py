"""What a spec says of a robot: its joints, units, sizes, and its place among other sub-models."""

from pathlib import Path

import numpy as np
import pytest

from compiler.ir import ops
from compiler.ir.nodes import needed
from spec_schema.diagnostics.diagnostic import SpecError
from tests.features.robots.robots import URDF, Z1, model_of, outputs_at

PLANAR = f"urdf: {URDF}/planar.urdf"
TREE = f"urdf: {URDF}/tree.urdf"


def codes(folder: Path, text: str) -> list[str]:
    try:
        return [found.code for found in model_of(folder, text).warnings]
    except SpecError as error:
        return [found.code for found in error.diagnostics]


def test_joints_stand_in_the_order_of_the_spec(tmp_path: Path) -> None:
    text = """
    dims: {{axis: [{0}]}}
    use: {{arm: {{robot: {{{1}, joints: axis}}}}}}
    inputs: {{q: {{dims: axis}}, dq: {{dims: axis}}, u: {{dims: axis}}}}
    outputs: {{a: "arm.forward_dynamics(q, dq, u)", M: arm.mass_matrix(q)}}
    """
    rng = np.random.default_rng(3)
    log = {name: rng.normal(size=(4, 2)) for name in ("q", "dq", "u")}
    forward = outputs_at(model_of(tmp_path, text.format("shoulder, elbow", PLANAR)).program, log)
    turned = {name: values[:, ::-1] for name, values in log.items()}
    back = outputs_at(model_of(tmp_path, text.format("elbow, shoulder", PLANAR)).program, turned)
    np.testing.assert_array_equal(back["a"], forward["a"][:, ::-1])
    np.testing.assert_array_equal(back["M"], forward["M"][:, ::-1, ::-1])


def test_a_joint_that_is_not_listed_is_held_at_zero(tmp_path: Path) -> None:
    text = f"""
    use: {{arm: {{robot: {{{PLANAR}, joints: [elbow]}}}}}}
    inputs: {{q: {{dims: arm.joint}}}}
    outputs: {{g: arm.gravity_torque(q)}}
    """
    assert codes(tmp_path, text) == ["W1201"]
    found = outputs_at(model_of(tmp_path, text).program, {"q": [[0.4]]})
    np.testing.assert_allclose(found["g"], [[0.2 * 9.81 * np.cos(0.4)]], rtol=1e-14)


def _gripper(elbow: str, elsewhere: str) -> str:
    """The planar arm with another elbow, and a hand whose last joint others follow."""
    text = (URDF / "planar.urdf").read_text()
    start = text.index('<joint name="elbow"')
    end = text.index("</joint>", start) + len("</joint>")
    hand = """
      <link name="nail"/>
      <joint name="tip" type="revolute"><parent link="hand"/><child link="nail"/></joint>"""
    return (text[:start] + elbow + text[end:]).replace("</robot>", f"{hand}{elsewhere}</robot>")


_BETWEEN = '<parent link="upper"/><child link="lower"/>'
_FOLLOWS = '<axis xyz="0 -1 0"/><mimic joint="knob" multiplier="2" offset="0.1"/></joint>'
_UP = 'xyz="0.5 0 -0.3" rpy="1.5707963267948966 0 0"'
_KNOB = """
  <link name="k"/>
  <joint name="knob" type="revolute"><parent link="base"/><child link="k"/>
    <mimic joint="tip" multiplier="-3" offset="0.1"/></joint>"""


@pytest.mark.parametrize(
    ("kind", "origin", "stands_at"),
    [
        ("revolute", 'xyz="0.5 0 0"', 'xyz="0.5 0 0" rpy="0 -0.3 0"'),
        ("prismatic", 'xyz="0.5 0 0"', 'xyz="0.5 -0.3 0"'),
        # along y of the joint, that is z of its parent
        ("prismatic", 'xyz="0.5 0 0" rpy="1.5707963267948966 0 0"', _UP),
    ],
)
def test_a_joint_that_follows_one_that_is_held_stands_where_that_puts_it(
    kind: str, origin: str, stands_at: str, tmp_path: Path
) -> None:
    """It kept the whole file from being read: 0.1 + 2 · (0.1 − 3 · 0)."""
    elbow = f'<joint name="elbow" type="{kind}">{_BETWEEN}<origin {origin}/>{_FOLLOWS}'
    fixed = f'<joint name="elbow" type="fixed">{_BETWEEN}<origin {stands_at}/></joint>'
    (tmp_path / "follows.urdf").write_text(_gripper(elbow, _KNOB))
    (tmp_path / "fixed.urdf").write_text(_gripper(fixed, ""))
    text = """
    use: {{arm: {{robot: {{urdf: {0}.urdf, joints: [{1}], frames: {{end: nail}}}}}}}}
    inputs: {{q: {{dims: arm.joint}}}}
    outputs: {{g: arm.gravity_torque(q), M: arm.mass_matrix(q), p: arm.end.position(q)}}
    """
    model = model_of(tmp_path, text.format("follows", "shoulder"))
    (told,) = model.warnings
    assert told.message == "joints held at 0: `tip`; `elbow` at 0.3; `knob` at 0.1"
    q = {"q": [[0.4], [-1.3]]}
    found = outputs_at(model.program, q)
    right = outputs_at(model_of(tmp_path, text.format("fixed", "shoulder")).program, q)
    for name in ("g", "M", "p"):
        np.testing.assert_allclose(found[name], right[name], rtol=1e-14, atol=1e-15)
    # what moves is followed by a mechanism that the file does not describe
    assert codes(tmp_path, text.format("follows", "shoulder, tip")) == ["E1212", "E1212"]
    assert codes(tmp_path, text.format("follows", "shoulder, elbow")) == ["E1212"]


def test_joints_that_follow_each_other_are_a_message(tmp_path: Path) -> None:
    elbow = f'<joint name="elbow" type="revolute">{_BETWEEN}{_FOLLOWS}'
    text = """
    use: {arm: {robot: {urdf: round.urdf, joints: [shoulder]}}}
    inputs: {q: {dims: arm.joint}}
    outputs: {g: arm.gravity_torque(q)}
    """
    for leader in ("elbow", "nobody"):
        (tmp_path / "round.urdf").write_text(_gripper(elbow, _KNOB.replace('"tip"', f'"{leader}"')))
        assert codes(tmp_path, text) == ["E1212", "E1212"]


@pytest.mark.parametrize("address", ["http://www.ros.org/wiki/xacro", "http://ros.org/wiki/xacro/"])
def test_xacro_under_another_prefix_is_told_as_such(address: str, tmp_path: Path) -> None:
    """The robot lacked without a word what the macros would have written."""
    text = (URDF / "planar.urdf").read_text()
    text = text.replace("<robot ", f'<robot xmlns:x="{address}" ')
    spec = """
    use: {arm: {robot: {urdf: macros.urdf}}}
    inputs: {q: {dims: arm.joint}}
    outputs: {g: arm.gravity_torque(q)}
    """
    (tmp_path / "macros.urdf").write_text(text)
    assert codes(tmp_path, spec) == []  # the name of the space alone asks for nothing
    (tmp_path / "macros.urdf").write_text(text.replace("</robot>", '<x:leg side="left"/></robot>'))
    assert codes(tmp_path, spec) == ["E1204"]


def test_units_follow_from_the_joints(tmp_path: Path) -> None:
    text = """
    use: {{arm: {{robot: {{{0}}}}}}}
    inputs: {{q: {{dims: arm.joint}}, u: {{dims: arm.joint}}}}
    outputs: {{a: "arm.forward_dynamics(q, 0, u)", M: arm.mass_matrix(q)}}
    """
    turning = model_of(tmp_path, text.format(PLANAR)).program
    units = [turning.step[output.node].type.unit for output in turning.outputs]
    assert [unit.text for unit in units if unit] == ["rad/s^2", "kg*m^2"]
    mixed = model_of(tmp_path, text.format(TREE)).program
    assert [mixed.step[output.node].type.unit for output in mixed.outputs] == [None, None]


def test_a_window_of_configurations_is_computed_at_each_sample(tmp_path: Path) -> None:
    model = model_of(
        tmp_path,
        f"""
        use: {{arm: {{robot: {{{PLANAR}}}}}}}
        inputs: {{q: {{dims: arm.joint}}}}
        outputs: {{now: arm.mass_matrix(q), three: "arm.mass_matrix(q.past(3))"}}
        """,
    )
    from compiler.interpreter.interpreter import Interpreter

    q = np.random.default_rng(0).normal(size=(5, 2))
    interpreter = Interpreter(model.program)
    rows = np.arange(2, 5)
    found = interpreter.step({"q": q}, rows, interpreter.start({"q": q}, rows)).outputs
    np.testing.assert_array_equal(found["three"][1:, :, :, 1], found["now"][:-1])


def test_gravity_and_armature_have_units(tmp_path: Path) -> None:
    model = model_of(
        tmp_path,
        f"""
        use:
          moon:
            robot:
              {PLANAR}
              gravity: [0, 0, -162 cm/s^2]
              armature: [0.1, 2000 kg*cm^2]
        inputs: {{q: {{dims: moon.joint}}}}
        outputs: {{g: moon.gravity_torque(q), M: moon.mass_matrix(q)}}
        """,
    )
    found = outputs_at(model.program, {"q": [[0.0, 0.0]]})
    np.testing.assert_allclose(found["g"], [[1.62 * 1.2, 1.62 * 0.2]], rtol=1e-14)
    np.testing.assert_allclose(found["M"][0, 1, 1], 0.02 + 0.04 + 0.2, rtol=1e-14)


def test_motors_stand_in_the_order_of_the_spec(tmp_path: Path) -> None:
    text = """
    use: {{arm: {{robot: {{{0}, joints: [elbow, shoulder], armature: {1}}}}}}}
    inputs: {{q: {{dims: arm.joint}}, ddq: {{dims: arm.joint}}}}
    outputs:
      M: arm.mass_matrix(q)
      tau: "arm.inverse_dynamics(q, 0, ddq)"
      a: "arm.forward_dynamics(q, 0, ddq)"
    """
    log = {"q": [[0.3, -0.7]], "ddq": [[1.0, -2.0]]}
    without, found = (
        outputs_at(model_of(tmp_path, text.format(PLANAR, armature)).program, log)
        for armature in ("0", "[0.1, 0.5]")
    )
    np.testing.assert_allclose(found["M"] - without["M"], [np.diag([0.1, 0.5])], atol=1e-14)
    np.testing.assert_allclose(found["tau"] - without["tau"], [[0.1, -1.0]], atol=1e-13)
    weight = outputs_at(
        model_of(tmp_path, text.format(PLANAR, "0")).program, log | {"ddq": [[0.0, 0.0]]}
    )["tau"]
    accelerations = np.linalg.solve(found["M"][0], np.array([1.0, -2.0]) - weight[0])
    np.testing.assert_allclose(found["a"], [accelerations], rtol=1e-12)


def test_a_robot_may_be_in_a_sub_model(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(
        f"""
msnn: 1
name: arm
sample_time: 10 ms
dims: {{joint: [shoulder, elbow]}}
use: {{body: {{robot: {{{PLANAR}, joints: joint, frames: {{tip: hand}}, learn: [mass]}}}}}}
inputs: {{q: {{dims: joint}}}}
outputs: {{g: body.gravity_torque(q), tip: body.tip.position(q)}}
""",
        encoding="utf-8",
    )
    model = model_of(
        tmp_path,
        """
        dims: {joint: [shoulder, elbow]}
        use: {left: {spec: arm.yaml, freeze: all}, right: arm.yaml}
        inputs: {q: {dims: joint}}
        connect: {left.q: q, right.q: -q}
        outputs: {g: left.g + right.g, tip: left.tip}
        """,
    )
    assert [parameter.name for parameter in model.program.parameters] == ["right.body.mass"]
    found = outputs_at(model.program, {"q": [[0.5, 0.2]]})
    right = outputs_at(model.program, {"q": [[0.5, 0.2]]}, {"right.body.mass": [4.0, 2.0]})
    np.testing.assert_allclose(right["g"], 1.5 * found["g"], rtol=1e-13)


def test_a_file_of_more_than_a_megabyte_is_refused(tmp_path: Path) -> None:
    (tmp_path / "large.urdf").write_text("<robot>" + " " * 1_000_000 + "</robot>")
    text = """
    use: {arm: {robot: large.urdf}}
    inputs: {q: 1}
    outputs: {y: q}
    """
    assert codes(tmp_path, text) == ["E1201"]


@pytest.mark.parametrize(
    "text", ["", "<robot>", "<robot/>", "<robot><link/></robot>", "\0", "<a/>"]
)
def test_what_is_no_robot_is_a_message(text: str, tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text(text)
    said = codes(tmp_path, "use: {arm: {robot: odd.urdf}}\ninputs: {q: 1}\noutputs: {y: q}\n")
    assert said
    assert all(code.startswith("E12") for code in said)


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        ('"turn" type="revolute"><limit lower="-1" upper="1" effort="inf" velocity="3"/>', []),
        ('"turn" type="revolute"><limit effort="1" velocity="3"/>', []),
        ('"turn" type="revolute"><limit lower="1" upper="-1"/>', ["E1225"]),
        ('"turn" type="prismatic"><limit lower="1" upper="-1"/>', ["E1225"]),
        ('"turn" type="continuous"><limit lower="1" upper="-1"/>', []),
        ('"turn" type="revolute"><limit lower="-1" upper="1" effort="5 N"/>', ["E1206"]),
        ('"turn" type="revolute"><limit lower="-1" upper="1" velocity="nan"/>', ["E1206"]),
    ],
)
def test_limits_are_numbers_in_their_order(joint: str, expected: list[str], tmp_path: Path) -> None:
    """They stop nothing here; `inf` is no limit, and what turns endlessly has none."""
    assert codes(tmp_path, _swinging(tmp_path, joint, "fixed")) == expected


@pytest.mark.parametrize(
    ("joint", "base", "expected"),
    [
        ('"base_yaw" type="revolute">', "floating", ["E1226"]),
        ('"base_yaw" type="revolute">', "fixed", []),
        ('"turn" type="revolute">', "floating", []),
    ],
)
def test_a_floating_base_has_its_names_for_itself(
    joint: str, base: str, expected: list[str], tmp_path: Path
) -> None:
    assert codes(tmp_path, _swinging(tmp_path, joint, base)) == expected


def _swinging(folder: Path, joint: str, base: str) -> str:
    """A spec of two links with this joint between, beside their file."""
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    inertial = f'<inertial><mass value="1"/>{inertia}</inertial>'
    links = f'<link name="base">{inertial}</link><link name="arm">{inertial}</link>'
    ends = '<parent link="base"/><child link="arm"/>'
    text = f'<robot name="two">{links}<joint name={joint}{ends}</joint></robot>'
    (folder / "two.urdf").write_text(text, encoding="utf-8")
    return f"""
    use: {{arm: {{robot: {{urdf: two.urdf, base: {base}}}}}}}
    inputs: {{q: {{dims: arm.joint}}}}
    outputs: {{g: arm.gravity_torque(q)}}
    """


def test_the_arm_of_six_joints_is_a_short_program(tmp_path: Path) -> None:
    model = model_of(
        tmp_path,
        f"""
        use: {{arm: {{robot: {{urdf: {Z1}, armature: 0.02}}}}}}
        inputs: {{q: {{dims: arm.joint}}, dq: {{dims: arm.joint}}, u: {{dims: arm.joint}}}}
        outputs: {{a: "arm.forward_dynamics(q, dq, u)"}}
        """,
    )
    graph = model.program.step
    used = needed(graph, [model.program.output("a").node])
    kinds = ops.Add | ops.Subtract | ops.Multiply | ops.Divide | ops.Negate | ops.Apply
    count = sum(1 for index, node in graph if used[index] and isinstance(node.op, kinds))
    # 1,500 are allowed; what is reached is kept
    assert count <= 1085


@pytest.mark.parametrize(
    ("call", "shape"),
    [
        ("arm.mass_matrix(q.past(3))", (1, 1, 3)),
        ("arm.gravity_torque(q.past(3))", (1, 3)),
        ("arm.hub.position(q.past(3))", (3, 3)),
        ('"arm.hub.jacobian(q.past(3), 0)"', (3, 3)),
    ],
)
def test_a_window_stays_where_no_configuration_changes_a_number(
    call: str, shape: tuple[int, ...], tmp_path: Path
) -> None:
    """What turns about the vertical has the same inertia, and no weight, at every angle."""
    text = _swinging(tmp_path, '"turn" type="revolute"><axis xyz="0 0 1"/>', "fixed")
    text = text.replace("base: fixed", "frames: {hub: base}")
    model = model_of(tmp_path, text.replace("g: arm.gravity_torque(q)", f"found: {call}"))
    node = model.program.output("found").node
    assert tuple(axis.size for axis in model.program.step[node].type.axes) == shape


def test_a_list_of_no_armatures_is_a_message(tmp_path: Path) -> None:
    text = _swinging(tmp_path, '"turn" type="revolute">', "fixed")
    assert codes(tmp_path, text.replace("base: fixed", "armature: []")) == ["E0215"]


@pytest.mark.parametrize(
    ("call", "other"), [("hub.position", "xyz"), ("mass_matrix", "joint2"), ("mass_matrix", "xyz")]
)
def test_an_argument_with_another_axis_of_the_result_is_refused(
    call: str, other: str, tmp_path: Path
) -> None:
    text = _swinging(tmp_path, '"turn" type="revolute">', "fixed")
    text = text.replace("base: fixed", "frames: {hub: arm}").replace("gravity_torque", call)
    text = text.replace("dims: arm.joint", f"dims: [arm.joint, arm.{other}]")
    wanted = [] if (call, other) == ("mass_matrix", "xyz") else ["E1219"]
    assert codes(tmp_path, text) == wanted


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [("1", []), ("1.00", []), ("1e0", []), ("-1", ["W1203"]), ("50", ["W1203"]), ("x", ["W1203"])],
)
@pytest.mark.parametrize("ros", ["1", "2"])
def test_a_gear_is_told_as_both_versions_of_ros_write_it(
    ros: str, ratio: str, expected: list[str], tmp_path: Path
) -> None:
    tag = "mechanicalReduction" if ros == "1" else "mechanical_reduction"
    gear = f'<joint name="turn"><{tag}>{ratio}</{tag}></joint>'
    found = f'<transmission name="gear">{gear}</transmission>'
    if ros == "2":
        found = f'<ros2_control name="arm" type="system">{found}</ros2_control>'
    text = _swinging(tmp_path, '"turn" type="revolute">', "fixed")
    file = tmp_path / "two.urdf"
    file.write_text(file.read_text().replace("</robot>", f"{found}</robot>"), encoding="utf-8")
    assert codes(tmp_path, text) == expected
