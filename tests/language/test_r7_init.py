"""R7: `init` is evaluated once, at t0, over the log, parameters and layers."""

import numpy as np
import pytest

from tests.language.compiled import codes, simulated

X = np.cos(np.arange(20.0))


@pytest.mark.parametrize(
    ("init", "expected"),
    [
        ("3", 3.0),
        ("k", 7.0),
        ("x", X[5]),
        ("x.meas", X[5]),
        ("x[t-2]", X[3]),
        ("mean(x[t-2:t+2])", X[3:8].mean()),
        ("(x[t+1] - x[t-1]) / (2 * dt)", (X[6] - X[4]) / 0.2),
        ("h(x)", X[4] + 10 * X[5]),
        ("slope", X[5] - X[4]),
    ],
)
def test_r7_init(init: str, expected: float) -> None:
    text = f"""
        inputs: {{x: m}}
        parameters: {{k: 7}}
        layers: {{h: {{fir: {{window: 2, init: [1, 10]}}}}}}
        equations: {{slope: "x - x[t-1]", used: "k + h(x) + slope"}}
        states:
          z: {{next: z, init: "{init}"}}
        outputs: {{y: z, u: used}}
        """
    assert simulated(text, {"x": X}, 5, 1)[0] == pytest.approx(expected, rel=1e-15)


def test_r7_without_init_a_state_starts_at_zero() -> None:
    text = "inputs: {x: m}\nstates: {z: {next: z + x}}\noutputs: {y: z}"
    np.testing.assert_array_equal(simulated(text, {"x": X}, 5, 3), [0, X[5], X[5] + X[6]])


def test_r7_the_log_of_a_state_starts_it() -> None:
    text = """
        inputs: {u: m}
        states: {z: {unit: m, next: z + u, init: "z.meas[t-1]"}}
        outputs: {y: z}
        """
    z = np.arange(20.0)
    np.testing.assert_array_equal(simulated(text, {"u": X, "z": z}, 5, 2), [4.0, 4.0 + X[5]])


@pytest.mark.parametrize("init", ["z", "next(z)", "flow(z)"])
def test_r7_init_never_reads_the_simulation(init: str) -> None:
    text = f"inputs: {{x: m}}\nstates: {{z: {{next: z + x, init: {init}}}}}\noutputs: {{y: z}}"
    assert len(codes(text)) == 1
