"""Draws what README shows: predicted positions, friction over speed, the arm.

    python figures.py

The picture of the arm needs OpenGL that draws without a screen (Debian: libosmesa6); without it the
picture stays as it is, and a word says so.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import truth
from evaluate import (
    HERE,
    HORIZON,
    SAMPLE_TIME,
    Array,
    Bodies,
    Friction,
    episodes,
    learned,
    regression,
    simulated,
    windows,
)

matplotlib.use("svg")
from matplotlib import pyplot as plt

STYLE = {"svg.hashsalt": "z1_friction", "svg.fonttype": "none", "font.size": 8}
SPARSE = 5  # samples from point to point of a curve
SHOWN = 2.5  # s of a test episode
SPEEDS = np.concatenate([-np.geomspace(3, 0.01, 30), [0.0], np.geomspace(0.01, 3, 30)])  # rad/s


def predictions(bodies: Bodies, frictions: dict[str, Friction], path: Path) -> None:
    """The positions of a test episode, begun anew at the measured state every 0.5 s."""
    test = windows(episodes("test")[:1])
    shown = round(SHOWN / (HORIZON * SAMPLE_TIME))
    t = SAMPLE_TIME * (np.arange(HORIZON) + 1)[SPARSE - 1 :: SPARSE]
    found = {name: simulated(bodies, friction, test) for name, friction in frictions.items()}
    figure, axes = plt.subplots(6, 2, figsize=(8, 8), sharex=True)
    for joint, (position, error) in enumerate(axes):

        def draw(where: plt.Axes, values: Array, style: str, label: str, joint: int) -> None:
            for k in range(shown):
                time = k * HORIZON * SAMPLE_TIME + t
                each = values[SPARSE - 1 :: SPARSE, k, joint]
                where.plot(time, each, style, linewidth=0.9, label=None if k else label)

        draw(position, test.q, "k", "measured", joint)
        for (name, q), style in zip(found.items(), ("C3", "C0--"), strict=True):
            draw(position, q, style, name, joint)
            draw(error, 1e3 * (q - test.q), style[:2], name, joint)
        position.set_ylabel(f"joint {joint + 1}, rad")
        error.set_ylabel("error, mrad")
    axes[0, 0].legend(fontsize=7)
    axes[-1, 0].set_xlabel("s")
    axes[-1, 1].set_xlabel("s")
    _save(figure, path)


def curves(friction: Friction, path: Path) -> None:
    """The torque of friction over speed at three positions of each joint, learned and true."""
    measured = np.concatenate([episode["q"] for episode in episodes("train")])
    places = np.quantile(measured, [0.1, 0.5, 0.9], axis=0)
    figure, axes = plt.subplots(2, 3, figsize=(8, 4.5), sharex=True)
    speeds = np.repeat(SPEEDS[:, None], 6, axis=1)
    for number, place in enumerate(places):
        q = np.broadcast_to(place, speeds.shape)
        torques = {"true": truth.friction(q, speeds), "learned": friction(q, speeds)}
        for joint, axis in enumerate(axes.flat):
            axis.plot(SPEEDS, torques["true"][:, joint], "0.6", linewidth=2.5)
            label = f"{round(place[joint], 1) + 0.0:.1f} rad"  # no -0.0
            axis.plot(SPEEDS, torques["learned"][:, joint], f"C{number}", label=label)
            axis.set_title(f"joint {joint + 1}")
            axis.legend(fontsize=6)
    for axis in axes[1]:
        axis.set_xlabel("rad/s")
    for axis in axes[:, 0]:
        axis.set_ylabel("N m")
    _save(figure, path)


def picture(path: Path) -> None:
    """The arm as a few capsules: its URDF has no meshes."""
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    import mujoco
    from generate_data import specification

    spec = specification()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 480, 360
    for body in spec.bodies[1:]:
        for child in body.bodies:
            if np.linalg.norm(child.pos) > 0.01:
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=np.concatenate([np.zeros(3), child.pos]),
                    size=[0.03, 0, 0],
                    rgba=[0.25, 0.45, 0.7, 1],
                )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.04, 0, 0], rgba=[0.85, 0.85, 0.85, 1]
        )
    world = spec.worldbody
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1], pos=[0, 0, -0.1], rgba=[1, 1, 1, 1]
    )
    world.add_light(pos=[1, -1, 2], dir=[-0.5, 0.5, -1])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0.4, 1.6, -1.2, 0.3, 0.2, 0.0]
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = [0.1, 0.05, 0.25], 1.2
    camera.azimuth, camera.elevation = 125, -15
    with mujoco.Renderer(model, 360, 480) as renderer:
        renderer.update_scene(data, camera)
        plt.imsave(path, renderer.render(), pil_kwargs={"optimize": True})


def _save(figure: plt.Figure, path: Path) -> None:
    """As SVG with coordinates of two decimals, and a path on one line."""
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    text = re.sub(r"<[^>]*>", _short, path.read_text(encoding="utf-8"))
    path.write_text(re.sub(r" *\n(?=[LMQCz])", " ", text), encoding="utf-8")


def _short(tag: re.Match[str]) -> str:
    """A tag with numbers of two decimals; what stands between tags is text to read."""
    return re.sub(r"(\d\.\d\d)\d+", r"\1", tag.group())


def main() -> None:
    if sys.argv[1:] == ["--arm"]:
        picture(HERE / "figures" / "arm.png")
        return
    (HERE / "figures").mkdir(exist_ok=True)
    own = learned(HERE / "runs" / "z1_friction" / "latest" / "weights.safetensors")
    bodies = Bodies()
    fitted = regression(bodies, episodes("train"), full=False)
    with plt.rc_context(STYLE):
        shown = {"least squares": fitted, "learned": own}
        predictions(bodies, shown, HERE / "figures" / "predictions.svg")
        curves(own, HERE / "figures" / "friction.svg")
    # a machine without such a library may end the process
    drawn = subprocess.run([sys.executable, __file__, "--arm"], capture_output=True, check=False)
    if drawn.returncode:
        print("no picture of the arm: nothing draws without a screen (libosmesa6, MUJOCO_GL)")


if __name__ == "__main__":
    main()
