"""Drives the steering example's own car with small equations in place of its package's.

The package is not installed where the suite runs. What is between it and the controllers is the
example's: the translation, the actuator, the variations, the numbers of `setting.py`.
"""

from __future__ import annotations

import importlib
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.conditions import require_tool

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "vehicle_steering"
Array = npt.NDArray[np.float64]

PACKAGE = {
    "__init__": "",
    "parameters_vehicle2": """
class Numbers:
    def __init__(self, **values):
        self.__dict__.update(values)


def parameters_vehicle2():
    names = ("m", "m_s", "m_uf", "m_ur", "I_Phi_s", "I_y_s", "I_z", "I_uf", "I_ur")
    return Numbers(
        a=1.2, b=1.4, h_cg=0.5, **dict.fromkeys(names, 2.0),
        steering=Numbers(v_min=-0.4, v_max=0.4), tire=Numbers(p_dx1=1.2, p_dy1=1.0),
    )
""",
    "init_mb": """
def init_mb(initial, p):
    x, y, angle, speed, heading, yaw_rate, slip = initial
    state = [x, y, angle, speed, heading, yaw_rate] + 23 * [0.0]
    state[16] = state[21] = 0.01 * p.m_s
    return state
""",
    "vehicle_dynamics_mb": """
import math


def vehicle_dynamics_mb(x, uInit, p):
    f = []
    u = []
    u.append(within(uInit[0], p.steering))
    u.append(uInit[1])
    body = p.m + p.m_s + p.m_uf + p.m_ur + p.I_Phi_s + p.I_y_s + p.I_z + p.I_uf + p.I_ur
    force = p.tire.p_dx1 * p.tire.p_dy1 * (x[3] * x[2] / (p.a + p.b) - x[5])
    f.append(x[3] * math.cos(x[4]))
    f.append(x[3] * math.sin(x[4]))
    f.append(u[0])
    f.append(u[1])
    f.append(x[5])
    f.append(200.0 * force / body)
"""
    + 23 * "    f.append(0.0)\n"
    + """    return f


def within(rate, p):
    if rate < p.v_min:
        rate = p.v_min
    elif rate > p.v_max:
        rate = p.v_max
    return rate
""",
}

Opened = Callable[[str, str], Callable[[str], Any]]


@pytest.fixture
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Gives modules of a copy of the example, in which a word of its setting is another."""
    require_tool("gcc", install="apt-get install gcc")
    modules = [path.stem for path in EXAMPLE.glob("*.py")]
    package = ["vehiclemodels", *(f"vehiclemodels.{name}" for name in PACKAGE)]
    installed = {name: sys.modules.pop(name) for name in list(sys.modules) if name in package}
    (tmp_path / "vehiclemodels").mkdir()
    for name, text in PACKAGE.items():
        (tmp_path / "vehiclemodels" / f"{name}.py").write_text(text, encoding="utf-8")
    for path in (*EXAMPLE.glob("*.py"), EXAMPLE / "car.c"):
        shutil.copy(path, tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    # bytecode is told from newer text by length and second: here both may be the same
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def forget() -> None:
        for name in (*modules, *package):
            sys.modules.pop(name, None)

    def open_copy(word: str, other: str) -> Callable[[str], Any]:
        forget()
        setting = (EXAMPLE / "setting.py").read_text(encoding="utf-8")
        assert setting.count(word) == 1, word
        (tmp_path / "setting.py").write_text(setting.replace(word, other), encoding="utf-8")
        importlib.invalidate_caches()
        return importlib.import_module

    yield open_copy
    forget()
    sys.modules.update(installed)


def trace(example: Callable[[str], Any], variation: int) -> Array:
    """What is recorded of a drive through a bend, in one of the variations."""
    drivers, setting, multi_body = example("drivers"), example("setting"), example("multi_body")
    car = multi_body.MultiBody(setting.VARIATIONS[variation])
    driver = drivers.Stanley(car.wheelbase, car.to_front, setting.REAR_SLIP)
    exploring = drivers.Exploring(driver, 1, setting.WAVES)
    road = example("roads").draw(replace(setting.TEST, bends=1))
    found = example("closed_loop").run(car, exploring, road, 1)
    return np.array(
        [found.x, found.y, found.angle, found.speed, found.yaw_rate, found.acceleration]
    )


@pytest.mark.parametrize(
    ("word", "other", "variation"),
    [
        ("SAMPLE_TIME = 0.05", "SAMPLE_TIME = 0.06", 0),
        ("SUBSTEPS = 50", "SUBSTEPS = 40", 0),
        ("lag: float = 0.08", "lag: float = 0.07", 0),
        ("rate: float = 0.4", "rate: float = 0.02", 0),
        ("limit: float = 0.6", "limit: float = 0.01", 0),
        ("speed: float = 0.05", "speed: float = 0.04", 0),
        ("acceleration: float = 0.1", "acceleration: float = 0.2", 0),
        ("yaw_rate: float = 0.002", "yaw_rate: float = 0.003", 0),
        ("angle: float = 0.001", "angle: float = 0.002", 0),
        ("mass=1.1", "mass=1.2", 1),
        ("mass=0.9", "mass=0.8", 2),
        ("friction=0.8", "friction=0.7", 3),
        ("delay=0.02", "delay=0.03", 4),
        ("sideways=5.0", "sideways=4.5", 0),
        ("WAVES = 0.005", "WAVES = 0.004", 0),
        ("9.81 * 21.92", "9.81 * 25.0", 0),
    ],
)
def test_every_number_of_the_setting_is_read(
    word: str, other: str, variation: int, opened: Opened
) -> None:
    before = trace(opened(word, word), variation)
    after = trace(opened(word, other), variation)
    assert before.shape != after.shape or not np.array_equal(before, after)


@pytest.mark.parametrize("rate", [0.2, 0.4, 0.8])
def test_the_wheels_turn_as_fast_as_the_setting_says(rate: float, opened: Opened) -> None:
    """It replaces the package's own limit, 0.4 rad/s, which would hide a faster actuator."""
    example = opened("rate: float = 0.4", f"rate: float = {rate}")
    car = example("multi_body").MultiBody(example("setting").VARIATIONS[0])
    car.start(0.0, 0.0, 0.0, 15.0)
    # 0.5 rad away, the lag of 80 ms would allow 6 rad/s
    assert car.step(0.5, 0.0).angle == pytest.approx(0.05 * rate, rel=1e-12)
    assert car.step(-0.5, 0.0).angle == pytest.approx(0.0, abs=1e-15)


def test_the_car_is_moved_on_by_runge_kutta_of_the_fourth_order(opened: Opened) -> None:
    """Below its rate the actuator is a lag of the first order, whose angles are known."""
    example = opened("lag: float = 0.08", "lag: float = 0.08")
    car = example("multi_body").MultiBody(example("setting").VARIATIONS[0])
    car.start(0.0, 0.0, 0.0, 15.0)
    found = [car.step(0.01, 0.0).angle for _ in range(4)]
    expected = -0.01 * np.expm1(-0.05 / 0.08 * np.arange(1, 5))
    # a step errs by z⁵/120 with z = 1 ms / 80 ms, 200 of them by 5.1e-10 of the angle at most; with
    # equal weights of the four slopes the third order fails, by z³/24 a step
    np.testing.assert_allclose(found, expected, rtol=5.1e-10)


def test_a_variation_changes_what_it_names_and_nothing_else(opened: Opened) -> None:
    example = opened("mass=1.1", "mass=1.1")
    multi_body, setting = example("multi_body"), example("setting")
    nominal, heavier, _, slippery, late = map(multi_body.MultiBody, setting.VARIATIONS)
    names = multi_body._package().translation.attributes
    factors = {name: (1.1 if name in multi_body.BODY else 1.0) for name in names}
    np.testing.assert_allclose(heavier._p, nominal._p * list(factors.values()), rtol=1e-15)
    factors = {name: (0.8 if name in multi_body.GRIP else 1.0) for name in names}
    np.testing.assert_allclose(slippery._p, nominal._p * list(factors.values()), rtol=1e-15)
    assert np.array_equal(late._p, nominal._p)
    assert (nominal._late, late._late) == (0, 20)  # of 50 steps in 50 ms
    for car in (nominal, heavier):  # tyres are pressed in by the weight
        car.start(0.0, 0.0, 0.0, 15.0)
    assert heavier.state[16] == pytest.approx(1.1 * nominal.state[16], rel=1e-15)
    # the package's Python is asked with the same parameters
    assert max(car.difference(0.1, 1.0) for car in (nominal, heavier)) == 0.0
    assert multi_body._package().parameters.m == 2.0


@pytest.mark.parametrize("name", ["m_typo", "h_cg"])
def test_a_parameter_that_no_equation_reads_is_refused_with_those_that_there_are(
    name: str, opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`h_cg` is a parameter of the package: a factor on it would vary nothing."""
    example = opened("mass=1.1", "mass=1.1")
    multi_body = example("multi_body")
    monkeypatch.setattr(multi_body, "BODY", ("m", name))
    with pytest.raises(ValueError, match=f"read no {name}; they read I_Phi_s, .* tire.p_dy1"):
        multi_body.MultiBody(example("setting").VARIATIONS[1])
