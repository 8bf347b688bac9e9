"""The spec of a robot arm whose equations are written out number by number, of any size."""

from __future__ import annotations

from collections.abc import Sequence

Vector = tuple[str, str, str]

_LEVER: Vector = ("0.3", "0", "0.1")
"""From one joint to the next, m."""


def written_out_arm(joints: int) -> str:
    """The text of a spec of an arm with that many joints, by recursive Newton-Euler equations.

    Links turn about their z axes, and each frame is perpendicular to the one before, so that sines
    and cosines of all joints are multiplied along the chain. Masses, first moments and inertias are
    learned.
    """
    equations = _Equations()
    turn: Vector = ("0", "0", "0")
    push: Vector = ("0", "0", "9.81")
    forces: list[Vector] = []
    bends: list[Vector] = []
    for i in range(1, joints + 1):
        equations.add(f"s{i}", f"sin(q{i})")
        equations.add(f"c{i}", f"cos(q{i})")
        x, y, z = _into(i, turn)
        carried = _sum(push, _cross(turn, equations.vector(f"swing{i}", _cross(turn, _LEVER))))
        turn = equations.vector(f"turn{i}", (x, y, f"{z} + w{i}"))
        push = equations.vector(f"push{i}", _into(i, equations.vector(f"carried{i}", carried)))
        moment = (f"0.1 * m{i}", f"h{i}", "0.02")
        inner = _cross(turn, equations.vector(f"inner{i}", _cross(turn, moment)))
        force = _sum(_scaled(f"m{i}", push), inner)
        spin = (f"0.1 * {turn[0]}", f"0.2 * {turn[1]}", f"J{i} * {turn[2]}")
        bend = _sum(_cross(turn, equations.vector(f"spin{i}", spin)), _cross(moment, push))
        forces.append(equations.vector(f"force{i}", force))
        bends.append(equations.vector(f"bend{i}", bend))
    force = bend = ("0", "0", "0")
    for i in range(joints, 0, -1):
        force = equations.vector(f"F{i}", _sum(forces[i - 1], force))
        bend = equations.vector(f"N{i}", _sum(bends[i - 1], bend))
        force = equations.vector(f"FF{i}", _out_of(i, force))
        bend = _sum(_out_of(i, bend), _cross(_LEVER, force))
    return _spec(joints, equations)


class _Equations:
    """The lines of the spec's section `equations`, in order."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, name: str, expression: str) -> None:
        self.lines.append(f"  {name}: {expression}")

    def vector(self, name: str, parts: Vector) -> Vector:
        """Adds three equations for the elements of a vector; returns their names."""
        names = (f"{name}x", f"{name}y", f"{name}z")
        for part_name, part in zip(names, parts, strict=True):
            self.add(part_name, part)
        return names


def _into(i: int, v: Vector) -> Vector:
    """Transforms a vector into the frame of link i."""
    return (f"c{i} * ({v[0]}) + s{i} * ({v[2]})", f"c{i} * ({v[2]}) - s{i} * ({v[0]})", v[1])


def _out_of(i: int, v: Vector) -> Vector:
    """Transforms a vector of link i into the frame of the link before."""
    return (f"c{i} * ({v[0]}) - s{i} * ({v[1]})", v[2], f"s{i} * ({v[0]}) + c{i} * ({v[1]})")


def _cross(a: Vector, b: Vector) -> Vector:
    return (
        f"({a[1]}) * ({b[2]}) - ({a[2]}) * ({b[1]})",
        f"({a[2]}) * ({b[0]}) - ({a[0]}) * ({b[2]})",
        f"({a[0]}) * ({b[1]}) - ({a[1]}) * ({b[0]})",
    )


def _sum(a: Vector, b: Vector) -> Vector:
    return (f"{a[0]} + {b[0]}", f"{a[1]} + {b[1]}", f"{a[2]} + {b[2]}")


def _scaled(factor: str, v: Vector) -> Vector:
    return (f"{factor} * {v[0]}", f"{factor} * {v[1]}", f"{factor} * {v[2]}")


def _spec(joints: int, equations: _Equations) -> str:
    numbers = range(1, joints + 1)

    def section(name: str, lines: Sequence[str]) -> list[str]:
        return [f"{name}:", *lines]

    parameters = [f"  m{i}: 1.{i}\n  h{i}: 0.0{i}\n  J{i}: 0.{i}" for i in numbers]
    loads = [f"u{i} - w{i} - 2 * sin(q{i}) - 0.01 * N{i}z" for i in numbers]
    states = [f"  q{i}: {{der: w{i}}}\n  w{i}: {{der: {loads[i - 1]}}}" for i in numbers]
    outputs = [f'  next{i}: {{expr: next(q{i}), predicts: "angle{i}[t+1]"}}' for i in numbers]
    lines = [
        "msnn: 1",
        f"name: arm_of_{joints}_joints",
        "sample_time: 0.01 s",
        *section("inputs", [f"  u{i}: 1" for i in numbers]),
        *section("targets", [f"  angle{i}: 1" for i in numbers]),
        *section("parameters", parameters),
        *section("equations", equations.lines),
        "integrator: euler",
        *section("states", states),
        *section("outputs", outputs),
    ]
    return "\n".join(lines) + "\n"
