"""R12: `fit:` of expressions, of several inputs and outputs, of high orders and many rows."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.training.starts.initial_weights import first_weights
from msnn.training.starts.lattice import denominator_of, lattice_of, reflections_of
from msnn.training.starts.linear_fit import (
    FilterStructure,
    UnbrokenRows,
    equations_of,
    fitted_filter,
)
from msnn.training.starts.linear_system import LinearSystem
from msnn.training.starts.state_space_fit import RowsWithoutGap, with_drive, with_read
from msnn.training.starts.subspace_fit import fitted_system
from tests.training.cases import compiled, dataset

SYSTEM = """
msnn: 1
name: fitted
sample_time: 1 s
dims: {out: 2, side: 3}
inputs: {u: V, v: V, q: {dims: side}}
targets: {y: m, w: {dims: out}, s: {dims: side}}
parameters: {k: 0.5}
equations: {e: "k * u**2"}
layers: {f: %s}
outputs: {z: {expr: "%s", predicts: "%s"}}
losses: {fit: "mse(z, %s)"}
train: [{epochs: 1, batch: 8, optimizer: {adam: {lr: 0.01}}, engine: torch}]
"""
ROWS = 400


def model(layer: str, call: str, target: str) -> Program:
    return compiled(SYSTEM % (layer, call, target, target))[0]


def simulated(matrix: FloatArray, drive: FloatArray, inputs: FloatArray) -> FloatArray:
    """The states before each row, one row after the other, from a state that nobody knows."""
    x = np.linspace(1.0, -1.0, len(matrix))
    found = np.empty((len(inputs), len(matrix)))
    for t, u in enumerate(inputs):
        found[t] = x
        x = matrix @ x + drive @ u
    return found


def turning(*poles: complex) -> FloatArray:
    """A with these poles and their conjugates."""
    found = np.zeros((2 * len(poles), 2 * len(poles)))
    for i, pole in enumerate(poles):
        block = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        found[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    return found


def series(seed: int = 0) -> dict[str, FloatArray]:
    random = np.random.default_rng(seed)
    data = {name: random.normal(size=ROWS) for name in ("u", "v", "y")}
    data |= {"q": random.normal(size=(ROWS, 3)), "s": np.zeros((ROWS, 3))}
    return {**data, "w": np.zeros((ROWS, 2))}


def free_run(program: Program, weights: dict[str, FloatArray], data: Any) -> FloatArray:
    """From row 5, where no window reaches before the record."""
    found = Interpreter(program, weights).rollout(data, [5], ROWS - 10).outputs["z"]
    return np.asarray(found)[0]


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        ("f(2 * u - v)", lambda d: 2 * d["u"] - d["v"]),
        ("f(e)", lambda d: 0.5 * d["u"] ** 2),
        ("f(u[t-3])", lambda d: np.concatenate((np.full(3, np.nan), d["u"][:-3]))),
        ("f(sum(u[t-2:t]))", lambda d: np.convolve(d["u"], np.ones(3))[:ROWS]),
        ("f(max(u, v) + 1)", lambda d: np.maximum(d["u"], d["v"]) + 1),
    ],
)
@pytest.mark.parametrize("layer", ["iir: {num: 1, den: 2", "state_space: {order: 2"])
def test_an_expression_of_inputs_leads_to_the_target(layer: str, call: str, argument: Any) -> None:
    data = series()
    w = np.nan_to_num(argument(data))
    states = simulated(turning(0.8 + 0.3j), np.array([[1.0], [0.0]]), w[:, None])
    data["y"] = states @ [0.4, -0.7]
    more = {f"{layer}, fit: 'y[t+1]'" + "}}": (0, 1), f"{layer}, fit: y" + "}}": (1, 0)}
    chosen, ahead = next((k, v[1]) for k, v in more.items() if v[0] == ("state" in layer))
    program = model("{" + chosen, call, "y[t+1]" if ahead else "y")
    weights = first_weights(program, dataset(data, train=[ROWS]))
    found = free_run(program, weights, data)
    # poles of 0.85: the unknown start is forgotten to 1e-12 after 200 rows
    wanted = data["y"][5 + ahead : 5 + len(found) + ahead]
    np.testing.assert_allclose(found[200:], wanted[200:], atol=1e-9)


@pytest.mark.parametrize(
    ("layer", "call", "target", "inputs"),
    [
        ("{state_space: {order: 4, fit: y}}", "f(u, v)", "y", "uv"),
        ("{state_space: {order: 4, fit: y}}", "f(q)", "y", "q"),
        ("{state_space: {order: 4, out: out, fit: w}}", "f(u)", "w", "u"),
        ("{state_space: {order: 4, out: out, fit: w}}", "f(u, q)", "w", "uq"),
        ("{state_space: {order: 4, out: out, feedthrough: true, fit: w}}", "f(q)", "w", "q"),
    ],
)
def test_a_system_of_several_signals_is_recovered(
    layer: str, call: str, target: str, inputs: str
) -> None:
    data, random = series(), np.random.default_rng(3)
    u = np.concatenate([data[name].reshape(ROWS, -1) for name in inputs], axis=1)
    matrix = turning(0.8 + 0.3j, 0.3 + 0.6j)
    states = simulated(matrix, random.normal(size=(4, u.shape[1])), u)
    outputs = states @ random.normal(size=(4, 1 if target == "y" else 2))
    if "feedthrough" in layer:
        outputs = outputs + u @ random.normal(size=(u.shape[1], 2))
    data[target] = outputs.reshape(data[target].shape)
    program = model(layer, call, target)
    weights = first_weights(program, dataset(data, train=[ROWS // 2], val=[ROWS - ROWS // 2]))
    found = free_run(program, weights, data)
    np.testing.assert_allclose(found[200:], data[target][205 : 5 + len(found)], atol=1e-9)


def test_each_element_of_a_vector_has_its_own_filter() -> None:
    data = series()
    for i, pole in enumerate((0.9, 0.5, -0.7)):
        for t in range(ROWS - 1):
            data["s"][t + 1, i] = pole * data["s"][t, i] + (i + 1) * data["q"][t, i]
    program = model("{iir: {num: 0, den: 1, fit: 's[t+1]'}}", "f(q)", "s[t+1]")
    weights = first_weights(program, dataset(data, train=[ROWS]))
    np.testing.assert_allclose(weights["f.num"][:, 0], [1, 2, 3], atol=1e-10)
    np.testing.assert_allclose(weights["f.reflection"][:, 0], [-0.9, -0.5, 0.7], atol=1e-10)


CLOSE = np.linspace(0.97, 0.995, 10) * np.exp(1j * np.linspace(0.01, 0.3, 10))


def close_poles(rows: int, noise: float) -> tuple[UnbrokenRows, FloatArray]:
    """A record of twenty poles within 0.3 rad, and the response without noise and start."""
    lattice = lattice_of(reflections_of(np.asarray([*CLOSE, *CLOSE.conj()], complex)))
    random = np.random.default_rng(7)
    u, gains = random.normal(size=(rows, 1)), random.normal(size=20)
    system = LinearSystem(lattice.matrix, lattice.drive[:, None])
    y = system.states(u, random.normal(size=20))[1:] @ gains
    clean = system.states(u, np.zeros(20))[1:] @ gains
    return UnbrokenRows(u[:, 0], y + noise * np.std(y) * random.normal(size=rows)), clean


@pytest.mark.parametrize(("noise", "share"), [(0.0, 1e-10), (0.01, 1e-3)])
def test_twenty_close_poles_are_found(noise: float, share: float) -> None:
    """Powers of 1/z over the denominator are dependent here: no digit of them would be left.

    With noise the best that any estimate can do is 0.01 · √(41 / 20000) = 4.5e-4 on average.
    """
    piece, clean = close_poles(20_000, noise)
    structure = FilterStructure(0, 20, 20, 1.0)
    found = fitted_filter([piece], structure)
    assert found is not None
    parts = [RowsWithoutGap(piece.input[:, None], piece.output[:, None])]
    drive = lattice_of(found.reflection).drive[:, None]
    arrays = with_read(parts, found.reflection, drive, radius=1.0, feedthrough=True)
    system = LinearSystem(lattice_of(found.reflection).matrix, arrays.drive)
    states = system.states(piece.input[:, None], np.zeros(20))
    response = states[:-1] @ arrays.read[0] + piece.input * arrays.direct[0, 0]
    assert np.std(response - clean) < share * np.std(clean)


def test_many_rows_fit_in_little_memory() -> None:
    rows = 75_000
    random = np.random.default_rng(0)
    u = random.normal(size=rows)
    y = LinearSystem(np.array([[0.9]]), np.ones((1, 1))).states(u[:, None], np.zeros(1))[1:, 0]
    tracemalloc.start()
    found = fitted_filter([UnbrokenRows(u, y)], FilterStructure(0, 20, 20, 1.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found is not None
    # the scaled copies of both series are 1 MB; a table of all rows would be 37 MB
    assert peak < 30e6


def past_columns(matrix: FloatArray, start: FloatArray, rows: int) -> FloatArray:
    found, x = np.empty((rows, len(start))), start
    for t in range(rows):
        found[t], x = x, matrix @ x
    return found


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("num", "den"), [(3, 3), (5, 2), (1, 4)])
def test_the_triangle_has_the_solution_of_the_dense_problem(first: int, num: int, den: int) -> None:
    """Judged by numpy on powers of 1/z over A, all rows in one table, two records."""
    random = np.random.default_rng(num)
    poles = np.array([0.9 + 0j, 0.5, -0.4, 0.2])[:den]
    reflection = reflections_of(poles)
    denominator, structure = denominator_of(reflection), FilterStructure(first, num, den, 1.0)
    pieces = [UnbrokenRows(random.normal(size=n), random.normal(size=n)) for n in (70, 9000)]
    triangle = equations_of(pieces, structure, reflection).triangle
    ours = np.linalg.lstsq(triangle[:, : structure.taps], triangle[:, structure.taps], rcond=None)
    error = np.linalg.norm(triangle[:, structure.taps] - triangle[:, : structure.taps] @ ours[0])
    blocks: list[FloatArray] = []
    width = 2 * structure.depth + structure.taps + 1
    for number, piece in enumerate(pieces):
        behind, impulse = (
            over(signal, denominator) for signal in (piece.input, np.eye(len(piece.input))[0])
        )
        block = np.zeros((len(behind), width))
        for lag in range(structure.depth):
            block[lag:, number * structure.depth + lag] = impulse[: len(behind) - lag]
        for lag in range(first, num + 1):
            column = 2 * structure.depth + lag - first
            block[lag:, column] = behind[: len(behind) - lag]
        block[:, -1] = piece.output
        blocks.append(block)
    dense = np.concatenate(blocks)
    found = np.linalg.lstsq(dense[:, :-1], dense[:, -1], rcond=None)[0]
    wanted = np.linalg.norm(dense[:, -1] - dense[:, :-1] @ found)
    # about 1e4 rows of size 1: both round by some 1e-16 of each
    np.testing.assert_allclose(error, wanted, rtol=1e-12)


def over(signal: FloatArray, denominator: FloatArray) -> FloatArray:
    found = np.zeros(len(signal))
    for n in range(len(signal)):
        reached = min(n, len(denominator) - 1)
        found[n] = signal[n] - denominator[1 : reached + 1] @ found[n - reached : n][::-1]
    return found


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("known", ["drive", "read"])
def test_arrays_at_given_poles_are_those_of_the_dense_problem(
    known: str, feedthrough: bool
) -> None:
    random = np.random.default_rng(5)
    reflection = reflections_of(np.array([0.7 + 0j, 0.2 + 0.4j, 0.2 - 0.4j]))
    matrix = 0.9 * lattice_of(reflection).matrix
    parts = [
        RowsWithoutGap(random.normal(size=(n, 2)), random.normal(size=(n, 2))) for n in (90, 60)
    ]
    drive, read = random.normal(size=(3, 2)), random.normal(size=(2, 3))
    if known == "drive":
        found = with_read(parts, reflection, drive, radius=0.9, feedthrough=feedthrough)
    else:
        found = with_drive(parts, reflection, read, radius=0.9, feedthrough=feedthrough)

    def error(arrays: tuple[FloatArray, FloatArray, FloatArray]) -> float:
        b, c, d = arrays
        squares = 0.0
        for part in parts:
            x = simulated(matrix, b, part.inputs) - past_columns(
                matrix, np.linspace(1.0, -1.0, 3), len(part.inputs)
            )
            rest = part.outputs - x @ c.T - part.inputs @ d.T
            free = np.stack([past_columns(matrix, e, len(rest)) for e in np.eye(3)], axis=2)
            if known == "read":  # one start for both outputs
                table = np.einsum("kn,tni->tki", c, free).reshape(-1, 3)
                rest = rest.reshape(-1, 1)
            else:  # C is not known: a start for each output and element
                table = past_columns(matrix, lattice_of(reflection).drive, len(rest))
            rest = rest - table @ np.linalg.lstsq(table, rest, rcond=None)[0]
            squares += float(np.sum(rest**2))
        return squares

    arrays = (found.drive, found.read, found.direct)
    least = error(arrays)
    free = {"drive": (1, 2), "read": (0, 2)}[known]
    for place in free if feedthrough else free[:1]:
        for index in np.ndindex(arrays[place].shape):
            for change in (-1e-3, 1e-3):
                moved = [array.copy() for array in arrays]
                moved[place][index] += change
                assert error((moved[0], moved[1], moved[2])) > least


@pytest.mark.parametrize("kind", ["constant", "noise", "unstable", "zero", "equal"])
def test_whatever_the_data_a_system_is_finite_and_stable(kind: str) -> None:
    random = np.random.default_rng(11)
    u, y = random.normal(size=(500, 2)), random.normal(size=(500, 2))
    match kind:
        case "constant":
            u, y = np.ones((500, 2)), np.full((500, 2), 3.0)
        case "unstable":
            y = 1.02 ** np.arange(500)[:, None] * np.ones(2)
        case "zero":
            u = y = np.zeros((500, 2))
        case "equal":
            y = u[:, :1].repeat(2, axis=1)
        case _:
            pass
    found = fitted_system([RowsWithoutGap(u, y)], 5, radius=0.999, feedthrough=True)
    assert found is not None
    arrays = (found.reflection, found.drive, found.read, found.direct)
    assert all(np.all(np.isfinite(array)) for array in arrays)
    assert np.all(np.abs(found.reflection) < 1)


def test_rows_that_do_not_determine_a_system_are_said() -> None:
    few = RowsWithoutGap(np.zeros((30, 2)), np.zeros((30, 2)))
    assert fitted_system([few], 20, radius=0.999, feedthrough=False) is None
