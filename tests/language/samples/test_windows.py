"""R1: windows are inclusive, oldest first, and durations become samples exactly once."""

import numpy as np
import pytest

from tests.language.compiled import codes, compiled, evaluated

X = np.arange(20.0) ** 2
INPUT = "inputs: {x: m}\n"
WEIGHTS = "constants: {w: [1, 10, 100]}\n"


@pytest.mark.parametrize(
    ("window", "rows"),
    [
        ("x[t-2:t]", (8, 9, 10)),
        ("x.past(3)", (8, 9, 10)),
        ("x.past(0.3 s)", (8, 9, 10)),
        ("x[t-0.2 s:t]", (8, 9, 10)),
        ("x.future(3)", (11, 12, 13)),
        ("x[t+1:t+3]", (11, 12, 13)),
        ("x[t-1:t+1]", (9, 10, 11)),
    ],
)
def test_window_holds_these_samples_oldest_first(window: str, rows: tuple[int, ...]) -> None:
    text = INPUT + WEIGHTS + f'outputs: {{y: "sum(w * {window})"}}'
    assert evaluated(text, {"x": X}, 10) == X[list(rows)] @ [1, 10, 100]


def test_a_single_sample_has_no_window() -> None:
    assert evaluated(INPUT + 'outputs: {y: "x[t-3] + x + x[t+2]"}', {"x": X}, 10) == 49 + 100 + 144


def test_a_shifted_expression_shifts_every_signal_in_it() -> None:
    text = """
        inputs: {x: m, u: N}
        parameters: {k: 3}
        functions:
          both: {args: [a, b], expr: "a[t-1] + b"}
        equations:
          e: k * x + both(u, x)
        outputs: {y: "e[t-2]"}
        """
    u = np.cos(np.arange(20.0))
    assert evaluated(text, {"x": X, "u": u}, 10) == 3.0 * X[8] + (u[7] + X[8])


def test_a_layer_with_a_window_takes_the_past_of_an_expression() -> None:
    text = """
        inputs: {x: m}
        layers: {h: {fir: {window: 0.3 s, init: [1, 10, 100]}}}
        outputs: {y: h(2 * x)}
        """
    assert evaluated(text, {"x": X}, 10) == 2 * X[8] * 1 + 2 * X[9] * 10 + 2 * X[10] * 100


def test_a_window_of_an_equation_reads_its_signals_over_the_window() -> None:
    text = """
        inputs: {x: m}
        equations: {e: "x[t-1] - x"}
        outputs: {y: "sum(e[t-2:t] * e[t-2:t])"}
        """
    differences = X[7:10] - X[8:11]
    assert evaluated(text, {"x": X}, 10) == pytest.approx(differences @ differences, rel=1e-15)


def test_offset_of_a_window_by_a_sample() -> None:
    text = INPUT + WEIGHTS + 'outputs: {y: "sum(w * (x[t-2:t] - x[t]))"}'
    assert evaluated(text, {"x": X}, 10) == (X[8:11] - X[10]) @ [1, 10, 100]


@pytest.mark.parametrize(("window", "code"), [("0.25 s", "E0601"), ("299 ms", "E0601")])
def test_nothing_is_rounded_silently(window: str, code: str) -> None:
    text = INPUT + f"layers: {{h: {{fir: {{window: {window}}}}}}}\noutputs: {{y: h(x)}}"
    assert codes(text) == [code]


@pytest.mark.parametrize("sample_time", ["0.1 s", "1 ms", "3 ms", "0.7 ms", "44.1 kHz"])
def test_three_samples_are_three_samples_at_any_sample_time(sample_time: str) -> None:
    seconds = {"0.1 s": 0.1, "1 ms": 1e-3, "3 ms": 3e-3, "0.7 ms": 0.7e-3, "44.1 kHz": 1 / 44100}
    duration = f"{3 * seconds[sample_time] * 1e6:.12g} us"
    text = f"sample_time: {sample_time}\n{INPUT}layers: {{h: {{fir: {{window: {duration}}}}}}}\n"
    program = compiled(text + "outputs: {y: h(x)}")
    assert program.parameter("h.weight").axes[0].size == 3


def test_a_window_of_something_constant_repeats_it() -> None:
    text = "inputs: {x: m}\nparameters: {k: 3}\n" + 'outputs: {y: "sum(k[t-3:t]) + x"}'
    assert evaluated(text, {"x": X}, 10) == 12 + 100
