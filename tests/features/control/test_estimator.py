"""The extended Kalman filter against plain numpy, against what it is to find, and at its edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import msnn
from msnn.features.control.kalman_filter import FilterStatus, KalmanFilter
from msnn.features.control.problem.state_estimation import EstimationProblem
from tests.features.control.specs import DELAYED, kalman_filter, load

Array = NDArray[np.float64]
LINEAR = """
msnn: 1
name: linear
sample_time: 0.25 s
inputs: {u: {}}
states:
  p: {unit: m, next: p + 0.25 * v, init: p.meas}
  v: {next: v + 0.25 * u, init: v.meas}
outputs:
  place: {expr: p, predicts: "p[t]"}
  speed: {expr: next(v), predicts: "v[t+1]"}
estimator:
  ekf:
    measured: {place: 20 cm, speed: 0.5}
    process: {p: 0.1, v: 0.4}
    initial: {p: 1, v: 2}
"""


def corrected(x: Array, P: Array, z: Array, C: Array, R: Array) -> tuple[Array, Array]:
    """The estimate and its covariance after z = C x + noise of covariance R was measured."""
    gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
    return x + gain @ (z - C @ x), (np.eye(len(x)) - gain @ C) @ P


def predicted(x: Array, P: Array, A: Array, moved: Array, Q: Array) -> tuple[Array, Array]:
    """Both a step later, of x' = A x + moved + noise of covariance Q."""
    return A @ x + moved, A @ P @ A.T + Q


def test_a_linear_model_is_kalmans_filter(tmp_path: Path) -> None:
    kalman = kalman_filter(load(tmp_path, LINEAR))
    kalman.reset({"p": 0.5, "v": 0.0})
    A, B = np.array([[1, 0.25], [0, 1]]), np.array([0, 0.25])
    Q, R = np.diag([0.01, 0.16]) * 0.25, np.diag([0.04, 0.25])
    x, covariance = np.array([0.5, 0.0]), np.diag([1.0, 4.0])
    random = np.random.default_rng(0)
    for _ in range(50):
        y, u = random.normal(size=2), random.normal()
        found = kalman.correct({"p": y[0], "v": y[1]})
        x, covariance = corrected(x, covariance, y, np.eye(2), R)
        assert found.status is FilterStatus.FILTERED
        np.testing.assert_allclose([found.states["p"], found.states["v"]], x, rtol=1e-11)
        np.testing.assert_allclose(kalman.covariance, covariance, rtol=1e-10, atol=1e-14)
        kalman.predict({"u": u})
        x, covariance = predicted(x, covariance, A, B * u, Q)


def test_nan_is_not_measured(tmp_path: Path) -> None:
    kalman, other = (kalman_filter(load(tmp_path, LINEAR)) for _ in range(2))
    for each in (kalman, other):
        each.reset({"p": 0.0, "v": 1.0})
    found = kalman.correct({"p": np.nan, "v": 1.2})
    alone = other.correct({"v": 1.2})
    assert np.isnan(found.innovations["p"])
    assert found.states == alone.states
    before = kalman.covariance
    nothing = kalman.correct({"p": np.nan})
    np.testing.assert_array_equal(kalman.covariance, before)
    assert nothing.status is FilterStatus.FILTERED


def test_past_samples_do_not_begin_with_what_is_not_finite(tmp_path: Path) -> None:
    kalman = msnn.estimator(load(tmp_path, DELAYED))
    kalman.reset({"y": 1.0})
    found = kalman.correct({"y": 1.1}, {"u": 0.0, "d": np.nan})
    assert found.status is FilterStatus.INPUT_NOT_FINITE
    assert kalman.predict({"u": np.inf, "d": 0.0}) is FilterStatus.INPUT_NOT_FINITE
    assert kalman.correct({"y": 1.1}, {"u": 0.0, "d": 0.0}).status is FilterStatus.FILTERED
    assert kalman.predict({"u": 0.0, "d": 0.0}) is FilterStatus.FILTERED


def test_what_is_not_finite_changes_nothing(tmp_path: Path) -> None:
    kalman = kalman_filter(load(tmp_path, LINEAR))
    assert kalman.correct({"p": 1.0}).status is FilterStatus.NOT_INITIALISED
    kalman.reset({"p": 0.0, "v": 1.0})
    before = kalman.correct({"p": 0.1})
    assert kalman.correct({"p": np.inf}).status is FilterStatus.INPUT_NOT_FINITE
    assert kalman.predict({"u": np.nan}) is FilterStatus.INPUT_NOT_FINITE
    assert kalman.correct({}).states == before.states


PENDULUM = """
msnn: 1
name: pendulum
sample_time: 0.05 s
inputs: {torque: {between: hold}}
parameters: {stiffness: {init: 6, min: 0}, damping: 0.3}
states:
  angle: {der: rate, init: angle.meas}
  rate: {der: -stiffness * sin(angle) - damping * rate + torque, init: rate.meas}
outputs:
  seen: {expr: sin(angle), predicts: "shadow[t]"}
targets: {shadow: {}}
estimator:
  ekf:
    measured: {seen: 0.02}
    process: {rate: 0.05}
    initial: {angle: 0.5, rate: 1}
    parameters: {stiffness: {std: 3, walk: 0.01, min: 1, max: 20}}
"""


def test_a_state_and_a_parameter_that_nobody_measures(tmp_path: Path) -> None:
    model = load(tmp_path, PENDULUM)
    true = {**msnn.initial_weights(model), "stiffness": 9.0}
    plant = msnn.stepper(msnn.load(tmp_path / "spec.msnn.yaml"), true)
    plant.reset(angle=0.8, rate=0.0)
    kalman = msnn.estimator(model)
    kalman.reset({"angle": 0.4, "rate": 0.5})
    random = np.random.default_rng(2)
    state, found = plant.state, kalman.correct({})
    for k in range(400):
        torque = float(np.sin(0.07 * k))
        state = plant.state
        shadow = np.sin(float(state["angle"])) + 0.02 * random.normal()
        found = kalman.correct({"shadow": shadow if k % 3 else np.nan})
        kalman.predict({"torque": torque})
        plant.step(torque=torque)
    # three standard deviations of each
    assert abs(found.parameters["stiffness"] - 9.0) <= 3 * found.std["stiffness"] < 0.6
    assert abs(found.states["rate"] - state["rate"]) <= 3 * found.std["rate"]


def test_the_covariance_stays_positive_in_single_precision(tmp_path: Path) -> None:
    model = load(tmp_path, LINEAR.replace("place: 20 cm", "place: 1e-4"))
    estimation = model.of(EstimationProblem)
    assert estimation is not None
    kalman = KalmanFilter(estimation, {}, np.float32)
    kalman.reset({"p": 0.0, "v": 0.0})
    for k in range(1000):
        kalman.correct({"p": np.sin(0.01 * k)})
        kalman.predict({"u": 0.0})
        assert np.array_equal(kalman.covariance, kalman.covariance.T)
        if not k % 100:
            assert np.linalg.eigvalsh(kalman.covariance.astype(float))[0] > 0
    assert kalman.covariance.dtype == np.float32


COUPLED = """
msnn: 1
name: coupled
sample_time: 1 s
dims: {o: 2}
inputs: {u: {}}
states:
  p: {next: 0.31 * p + 0.57 * q - 0.23 * r + u, init: 0}
  q: {next: 0.37 * q - 0.41 * p + 0.29 * r, init: 0}
  r: {next: 0.19 * p - 0.61 * q + 0.43 * r, init: 0}
outputs: {y: {expr: "stack(p + 0.5 * q, q - 2 * r, dim=o)", predicts: "z[t]"}}
targets: {z: {dims: o}}
estimator:
  ekf:
    measured: {y: 0.1}
    process: {p: 0.3, q: 0.3, r: 0.3}
    initial: {p: 1, q: 1, r: 1}
"""


A = np.array([[0.31, 0.57, -0.23], [-0.41, 0.37, 0.29], [0.19, -0.61, 0.43]])


def test_the_covariance_stays_symmetric_where_nothing_is_measured(tmp_path: Path) -> None:
    """A P Aᵀ is rounded to triangles that differ."""
    kalman = kalman_filter(load(tmp_path, COUPLED))
    wanted = np.eye(3)
    for _ in range(40):
        kalman.predict({"u": 0.0})
        assert np.array_equal(kalman.covariance, kalman.covariance.T)
        _, wanted = predicted(np.zeros(3), wanted, A, np.zeros(3), 0.09 * np.eye(3))
        np.testing.assert_allclose(kalman.covariance, wanted, rtol=1e-12, atol=1e-14)


def test_numbers_of_one_measurement_correct_as_all_at_once(tmp_path: Path) -> None:
    """One after the other, each against what those before it have moved already."""
    kalman = kalman_filter(load(tmp_path, COUPLED))
    C, R = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -2.0]]), 0.01 * np.eye(2)
    x, covariance = np.zeros(3), np.eye(3)
    random = np.random.default_rng(4)
    for _ in range(20):
        z, u = random.normal(size=2), random.normal()
        found = kalman.correct({"z": z})
        assert np.array_equal(kalman.covariance, kalman.covariance.T)
        x, covariance = corrected(x, covariance, z, C, R)
        np.testing.assert_allclose([found.states[name] for name in "pqr"], x, rtol=1e-9)
        kalman.predict({"u": u})
        x, covariance = predicted(x, covariance, A, np.array([u, 0, 0]), 0.09 * np.eye(3))


@pytest.mark.parametrize(("measured", "kept"), [(50.0, 2.0), (-50.0, 1.0)])
def test_a_parameter_stays_between_its_bounds(measured: float, kept: float, tmp_path: Path) -> None:
    text = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {u: {between: hold}, z: {}}
parameters: {k: 1.5}
states: {s: {next: 0.5 * s, init: 0}}
outputs: {y: {expr: k * u + s, predicts: z}}
estimator:
  ekf:
    measured: {y: 0.1}
    process: {s: 0.01}
    initial: {s: 0.01}
    parameters: {k: {std: 3, min: 1, max: 2}}
"""
    kalman = kalman_filter(load(tmp_path, text))
    assert kalman.correct({"z": 1.5}, {"u": 1.0}).parameters["k"] == 1.5
    assert kalman.correct({"z": measured}, {"u": 1.0}).parameters["k"] == kept


def test_a_signal_that_is_fed_back(tmp_path: Path) -> None:
    text = """
msnn: 1
name: fed_back
sample_time: 1 s
inputs: {u: {}, y: {}}
outputs: {y_next: {expr: "0.5 * y + 0.3 * y[t-1] + u[t-1]", predicts: "y[t+1]"}}
estimator: {ekf: {measured: {y_next: 0.1}, process: {y: 0.2}, initial: {y: 1}}}
"""
    kalman = msnn.estimator(load(tmp_path, text))
    kalman.reset({"y": 2.0, "u.history": [0.0]})
    first = kalman.correct({"y": 3.0})
    gain = 1 / (1 + 0.01)
    np.testing.assert_allclose(first.states["y.tape"], [2.0, 2.0 + gain], rtol=1e-12)
    kalman.predict({"u": 1.0})
    then = kalman.correct({"y": np.nan})
    np.testing.assert_allclose(then.states["y.tape"][1], 0.5 * (2 + gain) + 0.6, rtol=1e-12)


def test_wrong_names(tmp_path: Path) -> None:
    kalman = kalman_filter(load(tmp_path, LINEAR))
    with pytest.raises(ValueError, match="measured signals are"):
        kalman.correct({"q": 1.0})
    with pytest.raises(ValueError, match="inputs wanted for"):
        kalman.predict({})
    with pytest.raises(ValueError, match="no state or fed-back signal `q`"):
        kalman.reset({"q": 1.0})
    with pytest.raises(ValueError, match="has no `estimator` section"):
        msnn.estimator(load(tmp_path, LINEAR.partition("estimator:")[0]))


def test_an_input_that_a_measurement_reads_is_wanted(tmp_path: Path) -> None:
    """It counted as 0, and the estimate was that of a plant at rest."""
    text = """
msnn: 1
name: feedthrough
sample_time: 0.1 s
inputs: {u: {between: hold}, v: {between: hold}, y: {}}
states: {x: {next: 0.9 * x + 0.1 * v, init: 0}}
outputs: {o: {expr: x + 2 * u, predicts: y}}
estimator: {ekf: {measured: {o: 0.1}, process: {x: 0.1}, initial: {x: 1}}}
"""
    kalman = msnn.estimator(load(tmp_path, text))
    with pytest.raises(ValueError, match=r"inputs wanted for \['u'\], given for \[\]"):
        kalman.correct({"y": 2.0})
    with pytest.raises(ValueError, match=r"inputs wanted for \['u'\]"):
        kalman.expected()
    assert kalman.correct({"y": 2.0}, {"u": 1.0}).innovations["y"] == 0


def test_a_start_that_is_not_a_number_is_not_given(tmp_path: Path) -> None:
    """It once counted as known: every later sample diverged."""
    kalman = kalman_filter(load(tmp_path, LINEAR))
    kalman.reset({"p": np.nan, "v": 0.0})
    assert kalman.correct({"p": 0.1}).status is FilterStatus.NOT_INITIALISED
    kalman.reset({"p": np.inf, "v": 0.0})
    assert kalman.correct({"p": 0.1}).status is FilterStatus.NOT_INITIALISED
    kalman.reset({"p": 0.0, "v": 0.0})
    assert kalman.correct({"p": 0.1}).status is FilterStatus.FILTERED


def test_a_start_that_is_not_a_number_leaves_what_init_says(tmp_path: Path) -> None:
    kalman = kalman_filter(load(tmp_path, LINEAR.replace("init: v.meas", "init: 3")))
    kalman.reset({"p": 0.5, "v": np.nan})
    np.testing.assert_array_equal(kalman.vector, [0.5, 3.0])
    assert kalman.correct({"p": 0.5}).status is FilterStatus.FILTERED
