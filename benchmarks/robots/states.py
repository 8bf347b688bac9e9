"""Draws states of robots that are compared with other programs, and reads what msnn computes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.model.load import load_model

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
URDF = ROOT / "tests" / "features" / "robots" / "urdf"
Z1 = ROOT / "examples" / "z1_friction" / "z1.urdf"

SPEC = """
msnn: 1
name: robot
sample_time: 10 ms
use:
  arm:
    robot: {{urdf: {urdf}, base: {base}, armature: {armature}, frames: {{tip: {tip}}}}}
inputs:
  q: {{dims: arm.joint}}
  dq: {{dims: arm.joint}}
  ddq: {{dims: arm.joint}}
  tau: {{dims: arm.joint}}
outputs:
  forward: arm.forward_dynamics(q, dq, tau)
  inverse: arm.inverse_dynamics(q, dq, ddq)
  mass: arm.mass_matrix(q)
  gravity: arm.gravity_torque(q)
  coriolis: arm.coriolis(q, dq)
  position: arm.tip.position(q)
  velocity: arm.tip.jacobian(q, dq)
"""


@dataclass(frozen=True)
class Robot:
    """A robot to compare: its file, its base, the inertia of its motors, and one of its links."""

    name: str
    file: Path
    tip: str
    floats: bool = False
    armature: float = 0.0
    slides: bool = False
    recorded: bool = True

    def program(self) -> Program:
        """The program with all quantities that msnn computes of the robot."""
        base = "floating" if self.floats else "fixed"
        text = SPEC.format(urdf=self.file, base=base, armature=self.armature, tip=self.tip)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "robot.msnn.yaml"
            path.write_text(text, encoding="utf-8")
            return load_model(path).program


ROBOTS = (
    Robot("planar", URDF / "planar.urdf", "hand"),
    Robot("tree", URDF / "tree.urdf", "gripper", armature=0.03, slides=True),
    Robot("floating", URDF / "tree.urdf", "ram", floats=True, slides=True),
    Robot("z1", Z1, "gripper_mover", armature=0.02),
)


def turning_tree(folder: Path) -> Robot:
    """The tree on a floating base with joints that turn in place of those that slide.

    Its oblique axis has the length 1: ADAM 0.5 takes axes as they stand, others normalise them.
    """
    text = (URDF / "tree.urdf").read_text(encoding="utf-8")
    text = text.replace('type="prismatic"', 'type="revolute"')
    text = text.replace('xyz="1 2 -2"', f'xyz="{1 / 3} {2 / 3} {-2 / 3}"')
    file = folder / "turning_tree.urdf"
    file.write_text(text, encoding="utf-8")
    return Robot("turning tree", file, "ram", floats=True, armature=0.03, recorded=False)


def joints_of(program: Program) -> tuple[str, ...]:
    """The names of the elements of q."""
    return next(d.labels for d in program.dimensions if d.name.endswith("joint"))


def drawn(count: int, states: int) -> dict[str, Array]:
    """Random q, dq, ddq and tau with three decimals, so that their files are short."""
    rng = np.random.default_rng(7)
    widths = {"q": 1.4, "dq": 3.0, "ddq": 10.0, "tau": 10.0}
    return {
        name: np.round(rng.uniform(-width, width, (states, count)), 3)
        for name, width in widths.items()
    }


def computed(program: Program, log: dict[str, Array]) -> dict[str, Array]:
    """The outputs at every state."""
    interpreter = Interpreter(program)
    rows = np.arange(len(log["q"]))
    step = interpreter.step(log, rows, interpreter.start(log, rows))
    return dict(step.outputs)


def error_of(found: Array, expected: Array) -> float:
    """The largest error of any state, relative to its largest value or 1."""
    axes = tuple(range(1, expected.ndim))
    scale = np.maximum(np.max(np.abs(expected), axis=axes), 1.0)
    return float(np.max(np.max(np.abs(found - expected), axis=axes) / scale))
